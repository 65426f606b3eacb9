"""How large the errors are that a solution rests on, and what the answer owes to not
knowing them better.

The scanner's noise and the flange's errors, at each visit, commanded pose and
orientation, are variance components of the linear model at the solution. Its restricted
likelihood says how well errors of any sizes explain the residuals. Beforehand each size
has its law (`prior`); now and then a robot's errors are too small to matter, and where
less is stated than is usual, the usual is as likely. Few poses leave the sizes open.
The answer is therefore its average over all sizes, as likely as data and prior make
them, and its region is one that holds over all of them.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.optimize import brentq
from scipy.special import chdtrc, gammaln, ndtri, softmax

from profilecal.geometry.noise import FALSE_ALARM, chi2_limit
from profilecal.joint.linear_model import LinearModel, Posterior
from profilecal.joint.prior import Law, Prior

EXACT_ROBOT = 0.1  # odds that the robot's errors are far too small to matter
# sizes looked at, drawn from a t law of that many degrees of freedom
DRAWS, TAILS = 32, 4.0


def likeliest(model: LinearModel, law: Law, y, tolerance: float = 1e-3, most: int = 30):
    """The likeliest coordinates (d,), by Newton's method from some, and a root (d, d)
    of the inverse curvature there. Ends where a step promises less than `tolerance` of
    the log density; steps that do not raise it are damped.
    """

    def look(y):
        y = np.clip(y, -5.0, 5.0)  # standard deviations of the prior
        v, (first,), (second,) = law.variances(y[None])
        found = model.posterior(v)
        return found.log_evidence[0] - y @ y / 2, y, first, second, found

    here, damping = look(y), 0.0
    for _ in range(most):
        height, y, first, second, found = here
        gradient, information = (part[..., law.free] for part in model.gradient(found))
        information = first[:, None] * information[law.free] * first
        values, vectors = np.linalg.eigh(information + np.diag(1 - gradient * second))
        values = np.maximum(values, 0.5)  # a half of the prior's
        uphill = gradient * first - y
        step = vectors @ (vectors.T @ uphill / (values + damping))
        if uphill @ step / 2 < tolerance:
            break
        there = look(y + step * min(1.0, 2 / np.abs(step).max()))
        here, damping = (
            (there, damping / 4) if there[0] > height else (here, 4 * damping + 1)
        )
    return y, vectors / np.sqrt(values)


def draw(
    model: LinearModel, law: Law, likely, root
) -> tuple[np.ndarray, Posterior, np.ndarray]:
    """Sizes that a model allows: the logarithms (S,) of their weights, relative to
    those of other models, what follows from each, and the spread (d,) of the free ones'
    coordinates.

    Importance sampling from a t law about the likeliest coordinates (d,). Along each
    axis of `root` (d, d) it is as wide, in either direction, as the density is one
    standard deviation off (Rue, Martino and Chopin 2009).
    """
    d = len(likely)
    count = DRAWS if d else 1
    ends = likely + np.concatenate([np.zeros((1, d)), root.T, -root.T])
    height = (
        model.posterior(law.variances(ends)[0]).log_evidence
        - np.sum(ends**2, axis=1) / 2
    )
    # at most three times as wide
    wide = 1 / np.sqrt(2 * np.maximum(height[0] - height[1:], 1 / 18)).reshape(2, d)
    z = t_points(d, count)
    stretch = np.where(z > 0, *wide)
    y = likely + stretch * z @ root.T
    found = model.posterior(law.variances(y)[0])
    proposed = gammaln((TAILS + d) / 2) - gammaln(TAILS / 2) - d / 2 * np.log(TAILS / 2)
    proposed = proposed - (TAILS + d) / 2 * np.log1p(np.sum(z**2, axis=1) / TAILS)
    proposed = proposed - np.log(stretch).sum(axis=1) - np.linalg.slogdet(root)[1]
    log_weight = (
        found.log_evidence - np.sum(y**2, axis=1) / 2 - proposed - np.log(count)
    )
    weight = softmax(log_weight)
    spread = np.sqrt(np.maximum(weight @ y**2 - (weight @ y) ** 2, 0))
    return log_weight, found, spread


@cache
def t_points(d: int, count: int) -> np.ndarray:
    """Points (count, d) of a t law, evenly spread: in the unit cube, multiples of the
    powers of a generalised golden ratio (Roberts 2018), as many on either side of the
    middle.
    """
    ratio = brentq(lambda x: x ** (d + 2) - x - 1, 1, 2)
    points = (
        0.5
        + (np.arange(count)[:, None] - (count - 1) / 2)
        * ratio ** -np.arange(1.0, d + 2)
    ) % 1
    return ndtri(points[:, :d]) * np.sqrt(TAILS / chi2_limit(points[:, d:], TAILS))


@dataclass(frozen=True)
class Size:
    """How large one error is."""

    name: str  # the entry of `Noise`
    low: float  # 95 % between these
    middle: float
    high: float
    from_data: bool  # whether the data say it rather than the prior


@dataclass(frozen=True)
class ErrorSizes:
    """The sizes of all errors, and what is known of x (n,) if they are not known any
    better.
    """

    sizes: tuple[Size, ...]
    v: np.ndarray  # (1 + k,) the variances in their middle
    mean: np.ndarray  # (n,)
    covariance: np.ndarray  # (n, n)


def average(model: LinearModel, prior: Prior, start) -> ErrorSizes:
    """What is known over all sizes that data and prior allow. `start` (1 + k,):
    coordinates to look for the likeliest from, of which the first are taken.
    """
    names, beliefs = model.names, [(model, prior, 1.0)]  # with odds
    if names and not prior.robot_known:
        beliefs.append((model.without_robot(), prior.without_robot, EXACT_ROBOT))
        if prior.usual:
            beliefs.append((model, prior.usual, 1.0))
    draws = []
    for one, believed, odds in beliefs:
        law = believed.law(names)
        log_weight, found, spread = draw(
            one, law, *likeliest(one, law, start[: len(law.free)])
        )
        draws.append((log_weight + np.log(odds), found, spread, law.free))
    log_weights, parts, spreads, free = zip(*draws, strict=True)
    weight = softmax(np.concatenate(log_weights))
    v, means, covariances = (
        np.concatenate([getattr(p, name) for p in parts])
        for name in ("v", "mean", "covariance")
    )
    mean = weight @ means
    off = means - mean
    squares = covariances + off[:, :, None] * off[:, None]
    covariance = np.tensordot(weight, squares, 1)
    sizes, units = [], np.r_[prior.scales.profile_mm, np.ones(len(names))]
    for j, (name, size) in enumerate(
        zip(("profile_mm", *names), units[:, None] * np.sqrt(v).T, strict=True)
    ):
        order = np.argsort(size)
        share = np.cumsum(weight[order]) - weight[order] / 2
        # of the prior's 1
        from_data = j == 0 or spreads[0][free[0] == j].max(initial=0.0) < 0.6
        low, middle, high = map(
            float, np.interp([0.025, 0.5, 0.975], share, size[order])
        )
        sizes.append(Size(name, low, middle, high, bool(from_data)))
    middles = np.array([size.middle for size in sizes]) / units
    return ErrorSizes(
        tuple(sizes), middles**2, mean, covariance * growth(squares[:, :6, :6], weight)
    )


def growth(squares, weight) -> float:
    """How much larger than its mean the covariance of the sensor pose has to be for its
    region to hold over all sizes, but for a chance FALSE_ALARM. Squares (S, 6, 6) with
    weights (S,) are mean squares of the error; the squared error over the covariance is
    taken for a multiple of χ² for each of them (Satterthwaite 1946).
    """
    ratio = np.linalg.solve(np.tensordot(weight, squares, 1), squares)
    first, second = np.einsum("sii->s", ratio), np.einsum("sij,sji->s", ratio, ratio)
    limit = chi2_limit(FALSE_ALARM, 6)

    def excess(factor):
        return (
            weight @ chdtrc(first**2 / second, factor * limit * first / second)
            - FALSE_ALARM
        )

    return brentq(excess, 1.0, 1e3) if excess(1.0) > 0 else 1.0
