"""How large the errors are that a solution rests on, and what the answer owes to not
knowing them better.

The scanner's noise and the flange's errors, at each visit, commanded pose and
orientation, are variance components of the linear model at the solution. Its restricted
likelihood says how well errors of any sizes explain the residuals. Beforehand each size
has its law (`prior`); now and then a robot's errors are smooth alone, and where less
is stated than is usual, the usual is as likely. Few poses leave the sizes open.
The answer is therefore the average of the answers for all sizes, weighted as likely as
data and prior make these sizes, and its region is one that holds over all sizes.

In shapes, x has n + c entries: the n unknowns of `Problem`, and the c errors considered
(`linear_model`, where p = n + c, as no errors are tried). 1 + k is how many sizes there
are, the scanner's first, d how many of them are not known, and S how many draws.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy import ndarray
from scipy.optimize import brentq
from scipy.special import chdtrc, gammaln, ndtri, softmax, stdtrit

from profilecal.geometry.noise import FALSE_ALARM, SMOOTH, chi2_limit, in_mm
from profilecal.joint.linear_model import LinearModel, Posterior
from profilecal.joint.prior import Law, Prior
from profilecal.joint.restricted_likelihood import gradient
from profilecal.targets.state import Batch

SMOOTH_ALONE = 0.1  # odds that the robot's errors are smooth in the pose alone
# odds of each belief that an error of scanner or target is POORER times the usual, and
# of the belief that all are
POOR = 0.1
POORER = 10.0
LITTLE_ODDS = 0.01  # odds that a belief needs to count
DRAWS = 24  # sizes looked at
TAILS = 8.0  # degrees of freedom of the t law that each coordinate is drawn from
# irrational steps from draw to draw, along all axes but the first
STRIDES = np.sqrt([3, 5, 7, 11, 13, 17, 19, 23])
# coordinates of a normal law, one for each fortieth
NORMAL = ndtri((np.arange(40) + 0.5) / 40)
START_SIZES = np.linspace(-2.5, 1.5, 6)  # where the search of the likeliest begins
FARTHEST_COORDINATE = 5.0  # the likeliest coordinates are sought up to here
PROMISE = 1e-2  # of the log density: a step that promises less is the last
MOST_STEPS = 30  # to the likeliest coordinates
LEAST_CURVATURE = 0.5  # of the log density; the prior's is 1
LONGEST_STEP = 1.5  # of a coordinate
STEP = 1e-4  # of coordinates, for the derivatives of variances


@dataclass(frozen=True)
class Size:
    """How large one error is."""

    name: str  # the entry of `Noise`
    low: float  # 95 % between these
    middle: float
    high: float


@dataclass(frozen=True)
class ErrorSizes:
    """The sizes of all errors, and what is known of x (n + c,) if the sizes are not
    known any better. χ² is looked at with the median variances, covariances with the
    mean variances.
    """

    sizes: tuple[Size, ...]
    median_v: ndarray  # (1 + k,) of the variances
    mean_v: ndarray  # (1 + k,) of the variances
    mean: ndarray  # (n + c,) of x
    covariance: ndarray  # (n + c, n + c) of x, enlarged, with bends
    # the factor by which the covariance is enlarged, for its region to hold over all
    # sizes
    enlarged: float
    # degrees of freedom, at most 1000, with which all errors together are known, 100 mm
    # from the flange
    freedom: float
    poor: ndarray  # (n + c,) the chance that an error is POORER times the usual

    @property
    def of_robot(self) -> dict[str, float]:
        """The sizes of the robot's errors, roots of the mean variances, by name."""
        names = [size.name for size in self.sizes[1:]]
        return dict(zip(names, np.sqrt(self.mean_v[1:]).tolist(), strict=True))


@dataclass(frozen=True)
class Likeliest:
    """The likeliest sizes of errors."""

    y: ndarray  # (d,) their coordinates
    # (d, d) the symmetric root of the inverse curvature there: it does not depend on
    # the sign and the order that eigenvectors happen to have
    root: ndarray
    # at the last coordinates looked at: y, or the ones before the last small step
    posterior: Posterior
    # of all sizes together, as if their density were normal (Laplace)
    log_evidence: float


def likeliest(model: LinearModel, law: Law, y: ndarray | None = None) -> Likeliest:
    """The likeliest sizes, by Newton's method from some coordinates `y` (d,), or from
    the best of several that all errors of the robot have.

    The log density of the coordinates is, with the log evidence ℓ of the variances v
    and the standard normal prior, but for a constant

        h(y) = ℓ(v(y)) - yᵀ y / 2

    With the gradient g of ℓ and its average information I, where v'' is diagonal,

        ∂h/∂y = g v' - y        -∂²h/∂y² ≈ v' I v' + 1 - g v''

    Curvatures of less than LEAST_CURVATURE are taken for that. No step changes a
    coordinate by more than LONGEST_STEP; steps that lower h are halved. The last step
    is the first one that promises less than PROMISE of h, halved or not: h and the
    curvature are then those before it. Where the data leave an unknown open, g is less
    exact than that, and only halved steps end the search.
    """
    if y is None:
        # `free` are numbers of sizes: 0, the scanner's, starts at its scale
        some = np.outer(START_SIZES, law.free > 0)
        heights = log_density(model.posterior(law.variances(some)), some)
        y = some[np.argmax(heights)]

    def look(y: ndarray) -> tuple[float, ndarray, Posterior]:
        """h and what follows there, and variances (3, d) before, there and after."""
        around = law.variances(y + STEP * np.array([[-1], [0], [1]]))
        posterior = model.posterior(around[[1]])
        return log_density(posterior, y[None])[0], around[:, law.free], posterior

    h, around, posterior = look(y)
    for _ in range(MOST_STEPS):
        before, here, after = around
        slope = (after - before) / (2 * STEP)
        bend = (after - 2 * here + before) / STEP**2
        g, information = (part[..., law.free] for part in gradient(model, posterior))
        information = slope[:, None] * information[law.free] * slope
        values, vectors = np.linalg.eigh(information + np.diag(1 - g * bend))
        values = np.maximum(values, LEAST_CURVATURE)
        uphill = g * slope - y
        step = vectors @ (vectors.T @ uphill / values)
        step *= LONGEST_STEP / np.abs(step).max(initial=LONGEST_STEP)  # or shorter
        step = np.clip(y + step, -FARTHEST_COORDINATE, FARTHEST_COORDINATE) - y
        while uphill @ step / 2 >= PROMISE and (there := look(y + step))[0] < h:
            step = step / 2
        y = y + step
        if uphill @ step / 2 < PROMISE:
            break
        h, around, posterior = there
    root = vectors / np.sqrt(values) @ vectors.T
    return Likeliest(y, root, posterior, h + np.linalg.slogdet(root)[1])


def draw(
    model: LinearModel, law: Law, likely: Likeliest
) -> tuple[ndarray, ndarray, Posterior]:
    """Sizes that a model allows: the logarithms (S,) of their weights, relative to
    those of other models; the coordinates (S, d) of the free ones; and what follows
    from each.

    Importance sampling of the density exp h(y) of the coordinates (`likeliest`), in d
    dimensions. Draws are

        y = ŷ + R (s ∘ z),    z_i ~ t law of ν degrees of freedom

    about the likeliest coordinates ŷ, R the `root`. Along each column R_i the draws
    have, in either direction, the width that the density one standard deviation off
    tells (Rue, Martino and Chopin 2009): were h a parabola of width s,
    h(ŷ) - h(ŷ ± R_i) = 1 / (2 s²), so

        s_i± = (2 (h(ŷ) - h(ŷ ± R_i)))^(-1/2),  at most 3

    and s_i is one of them by the sign of z_i. The draws have the density, over
    (2π)^(-d/2) as the prior's in h,

        q(y) = Π (2/ν)^(1/2) Γ((ν + 1)/2) / Γ(ν/2) (1 + z_i²/ν)^(-(ν + 1)/2) / s_i
               / |det R|

    and of S draws each has the weight w = exp h(y) / (q(y) S). The weights add up to
    the evidence of the model, by which models are compared.
    """
    root = likely.root
    d = len(root)
    count = DRAWS if d else 1
    ends = likely.y + np.concatenate([np.zeros((1, d)), root.T, -root.T])
    h = log_density(model.posterior(law.variances(ends)), ends)
    widths = 1 / np.sqrt(2 * np.maximum(h[0] - h[1:], 1 / 18))
    forward, backward = widths.reshape(2, d)

    z = t_points(d, count)
    s = np.where(z > 0, forward, backward)
    y = likely.y + s * z @ root.T
    posterior = model.posterior(law.variances(y))
    t_peak = gammaln((TAILS + 1) / 2) - gammaln(TAILS / 2) - np.log(TAILS / 2) / 2
    log_t = t_peak - (TAILS + 1) / 2 * np.log1p(z**2 / TAILS)
    log_q = np.sum(log_t - np.log(s), axis=1) - np.linalg.slogdet(root)[1]
    return log_density(posterior, y) - log_q - np.log(count), y, posterior


def log_density(posterior: Posterior, y: ndarray) -> ndarray:
    """h (S,) of coordinates y (S, d), from the posterior at their variances."""
    return posterior.log_evidence - np.sum(y**2, axis=1) / 2


@cache
def t_points(d: int, count: int) -> ndarray:
    """Points (count, d) of a t law along each axis, evenly spread.

    In the unit cube they are as many on either side of the middle, in even steps along
    the first axis and in STRIDES, modulo one, along the others (Richtmyer 1951).
    """
    numbers = np.arange(count) - (count - 1) / 2
    points = (0.5 + np.outer(numbers, [1 / count, *STRIDES])) % 1
    return stdtrit(TAILS, points[:, :d])


@dataclass(frozen=True)
class Weighed(Batch):
    """What follows from N sizes of errors, draw after draw of one belief, then the
    next one's.
    """

    log_weight: ndarray  # (N,)
    x: ndarray  # (N, n + c)
    covariance: ndarray  # (N, n + c, n + c)
    v: ndarray  # (N, 1 + k)
    poor: ndarray  # (N, n + c) which errors are believed POORER times the usual


class Belief(NamedTuple):
    """What follows from a law of the sizes of errors."""

    law: Law
    y: ndarray  # (S, d) coordinates drawn
    # what follows from the S draws, once for each belief about scanner and target
    weighed: Weighed


def average(model: LinearModel, prior: Prior, likely: Likeliest) -> ErrorSizes:
    """What is known over all sizes that data and prior allow. `likely`: the likeliest
    ones.

    Each belief about the errors has its draws, whose weights count as the belief's odds
    (`draw`). Of all draws together, with weights w that add up to one, x has the mean
    and, by the law of total variance, the covariance

        x̄ = Σ w x̂        Σ w (V + (x̂ - x̄) (x̂ - x̄)ᵀ)

    The covariance is then enlarged until its region holds over all sizes (`growth`),
    and the covariance by bends of smooth errors is added.
    """
    law = prior.law(model.names)
    beliefs = [of_scanners(model, law, likely), *of_robots(model, prior, likely)]
    draws = Weighed.join(*(belief.weighed for belief in beliefs))
    w = softmax(draws.log_weight)
    mean = w @ draws.x
    off = draws.x - mean
    squared_errors = draws.covariance + off[:, :, None] * off[:, None]
    covariance = np.tensordot(w, squared_errors, 1)
    enlarged = growth(squared_errors[:, :6, :6], w)

    names = ("profile_mm", *model.names)
    units = np.r_[prior.scales.profile_mm, np.ones(len(model.names))]
    sizes = sizes_of(beliefs, names, units)
    medians = np.array([size.middle for size in sizes]) / units
    # smooth errors do not count here: they are not drawn anew at each pose
    sizes_mm = units * [in_mm(name) * (name != SMOOTH) for name in names]
    together = draws.v @ sizes_mm**2
    mean_v = w @ draws.v
    # χ² of f degrees of freedom has the relative variance 2 / f
    relative = w @ (together / (w @ together) - 1) ** 2
    return ErrorSizes(
        sizes=sizes,
        median_v=medians**2,
        mean_v=mean_v,
        mean=mean,
        covariance=enlarged * covariance + model.by_bends(mean_v),
        enlarged=enlarged,
        freedom=float(2 / max(relative, 2e-3)),
        poor=w @ draws.poor,
    )


def sizes_of(
    beliefs: Sequence[Belief], names: Sequence[str], units: ndarray
) -> tuple[Size, ...]:
    """How large the errors of these names are, in their `units` (1 + k,).

    By each belief, the coordinate of a size has a normal law of the mean and the spread
    of its draws, because so few draws have no tails. Each of NORMAL stands for an equal
    part of that law, and each belief has its share.
    """
    believed, log_share = [], []
    for law, y, weighed in beliefs:
        # of each draw, over all beliefs about scanner and target, in `Weighed`'s order
        log_weight = np.logaddexp.reduce(weighed.log_weight.reshape(-1, len(y)))
        of_draw = softmax(log_weight)
        centre = of_draw @ y
        spread = np.sqrt(of_draw @ (y - centre) ** 2)
        quantiles = centre + spread * NORMAL[:, None]
        believed.append(units * np.sqrt(law.variances(quantiles)))
        log_share += [np.logaddexp.reduce(log_weight)] * len(NORMAL)
    share = softmax(log_share)

    sizes = []
    columns = np.concatenate(believed).T
    for name, values in zip(names, columns, strict=True):
        order = np.argsort(values)
        rank = np.cumsum(share[order]) - share[order] / 2
        low, middle, high = np.interp([0.025, 0.5, 0.975], rank, values[order]).tolist()
        sizes.append(Size(name, low, middle, high))
    return tuple(sizes)


def of_scanners(model: LinearModel, law: Law, likely: Likeliest) -> Belief:
    """What follows by the belief that all errors of scanner and target are as usual,
    and by the beliefs that one of them, or all, are POORER times as large. Beliefs that
    the residuals speak against are left out.

    The draws are those of the likeliest belief. They serve the others, too: how much
    the data favour a poor scanner hardly depends on the sizes.
    """
    one_poor = np.eye(model.p)[model.may_be_poor]
    all_poor = one_poor.sum(axis=0, keepdims=True)
    # (B, n + c) 1 where an error is POORER times the usual: for none of them, which
    # stands first, for each, and for all, which is one belief where there is one error
    poor = np.unique(np.concatenate([0 * all_poor, one_poor, all_poor]), axis=0)
    log_odds = np.log(np.where(poor.any(axis=1), POOR, 1.0))
    at_peak = log_odds + model.rescaled(likely.posterior, POORER**poor)[0][:, 0]
    best = poor[np.argmax(at_peak)]
    if best.any():  # the draws are to be those of this belief
        times = POORER**best
        precision = model.precision / np.outer(times, times)
        model = replace(model, precision=precision)
        likely = likeliest(model, law, likely.y)
    counts = at_peak > at_peak.max() + np.log(LITTLE_ODDS)
    poor, log_odds = poor[counts], log_odds[counts]
    # the log evidence is without log |Π| / 2, which is lower by log POORER for each
    # error that the model now has so large
    log_odds = log_odds - np.log(POORER) * best.sum()
    log_weight, y, posterior = draw(model, law, likely)
    gain, x, V = model.rescaled(posterior, POORER ** (poor - best))
    weighed = Weighed(
        log_weight=(log_weight + gain + log_odds[:, None]).ravel(),
        x=x.reshape(-1, model.p),
        covariance=V.reshape(-1, model.p, model.p),
        v=np.tile(posterior.v, (len(poor), 1)),
        poor=poor.repeat(len(y), axis=0),
    )
    return Belief(law, y, weighed)


def of_robots(model: LinearModel, prior: Prior, likely: Likeliest) -> Iterator[Belief]:
    """What follows by the rivals of the belief in `prior`, whose likeliest sizes are
    `likely`: that the robot errs smoothly alone, and that it errs as usual where less
    is stated. Rivals that the data speak against are left out.
    """
    if not model.names or prior.robot_known:
        return
    rivals = [(model.without_fresh(), prior.without_robot, SMOOTH_ALONE)]
    if prior.usual:
        rivals.append((model, prior.usual, 1.0))
    for other, belief, odds in rivals:
        law = belief.law(model.names)
        own = likeliest(other, law)
        log_odds = np.log(odds) + own.log_evidence - likely.log_evidence
        if log_odds < np.log(LITTLE_ODDS):
            continue
        log_weight, y, posterior = draw(other, law, own)
        weighed = Weighed(
            log_weight=log_weight + np.log(odds),
            x=posterior.mean,
            covariance=posterior.covariance,
            v=posterior.v,
            poor=np.zeros_like(posterior.mean),
        )
        yield Belief(law, y, weighed)


def growth(squared_errors: ndarray, weight: ndarray) -> float:
    """How much larger than its mean the covariance of the sensor pose has to be for its
    region to hold over all sizes, but for a chance FALSE_ALARM.

    Mean squared errors U_i (S, 6, 6) have the weights w_i (S,) and the mean U. If U_i
    is true, the squared error e² = εᵀ U⁻¹ ε has the mean a = tr U⁻¹U_i and the variance
    2 b, b = tr (U⁻¹U_i)². It is taken for b/a times χ² with a²/b degrees of freedom
    (Satterthwaite 1946). The factor is the one at which, on average over w, the chance
    that e² exceeds the factor times the limit of χ² with six degrees of freedom is
    FALSE_ALARM.
    """
    mean = np.tensordot(weight, squared_errors, 1)
    ratio = np.linalg.inv(mean) @ squared_errors
    a = np.einsum("sii->s", ratio)
    b = np.einsum("sij,sji->s", ratio, ratio)
    freedom, limits = a**2 / b, chi2_limit(FALSE_ALARM, 6) * a / b

    def excess(factor: float) -> float:
        return weight @ chdtrc(freedom, factor * limits) - FALSE_ALARM

    return brentq(excess, 1.0, 1e3) if excess(1.0) > 0 else 1.0
