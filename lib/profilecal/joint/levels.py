"""How large the errors are that a solution rests on, and what the answer owes to not knowing them better.

The scanner's noise and the flange's errors, at each visit, commanded pose and orientation, are variance components of a
linear model: the residuals at a solution with their derivatives. The restricted likelihood (Patterson and Thompson
1971) says how well errors of any sizes explain the residuals. What is known beforehand is a prior: the robot errs at
its poses or does not; if it does, the poses of an orientation share errors or do not; each as likely. Where an error is
there, its size follows a half-t law (Gelman 2006), whose scale is what the user states or what robots usually do. What
is stated may be far too small, a data sheet's repeatability for instance: its law has the longer tail, and where less
is stated than is usual, the usual is as likely. Few poses leave the sizes open. The covariance of the answer is
therefore its average over all sizes, as likely as data and prior make them.

The robot's accuracy (`joint.field`) is one more component. Its prior is log-normal: nobody's robot is exact.
"""

from collections.abc import Iterator
from copy import copy
from dataclasses import asdict, dataclass, replace
from functools import cache

import numpy as np
from scipy.optimize import brentq, minimize
from scipy.special import gammaln, ndtr, ndtri, stdtr, stdtrit

from profilecal.geometry.noise import ROBOT, Noise, chi2_limit
from profilecal.joint.effects import Information, remove, rows_of
from profilecal.joint.field import Field
from profilecal.joint.observability import POSE_UNITS, RANK
from profilecal.joint.problem import Problem, gram_by_pose
from profilecal.joint.state import State

USUAL = Noise(  # of robots, where nothing is stated: scales of the prior, the same at a pose and at an orientation
    position_mm=0.05,
    orientation_deg=0.02,
    group_position_mm=0.05,
    group_orientation_deg=0.02,
    repeatability_mm=0.02,
    repeatability_deg=0.005,
)
FREEDOM, FREEDOM_OF_STATED = 3.0, 1.0  # degrees of freedom of the half-t law
LARGEST = 100.0  # times a scale: a larger error is a mistake
FACTOR = np.log(2)  # standard deviation of the logarithm of a robot's accuracy over what is stated
ACCURACY = ("accuracy_mm", "accuracy_deg")
SHARED = ("group_position_mm", "group_orientation_deg")  # by the poses of an orientation
OF_POSES = ("position_mm", "orientation_deg")
FARTHEST = 5.0  # of a size's coordinate
DRAWS, TAILS = 128, 4.0  # sizes looked at, drawn from a t law of that many degrees of freedom
NEGLIGIBLE = 30.0  # minus twice the logarithm of one density over another: its draws need not be looked at
STEP, BROAD_STEP = 1e-3, 0.1  # of a size's coordinate, for the first derivative and for the second
ENOUGH = 1e-5  # of minus twice the logarithm of the density: less moves an answer by a hundredth of its deviation
TOLD = 0.6  # a size is known from the data if they leave it less open than that, the prior being 1


@dataclass(frozen=True)
class Prior:
    """What is known beforehand of how large errors are."""

    scales: Noise
    stated: frozenset[str] = frozenset()  # by the user; the other scales are usual ones
    profile_spread: float = 0.0  # of the logarithm of the scanner's noise; 0: it is known

    def with_scanner(self, noise_mm: float) -> "Prior":
        """The same with this scale of the scanner's noise."""
        return replace(self, scales=replace(self.scales, profile_mm=noise_mm))

    def usual(self) -> "Prior":
        """The same with the usual scales in place of smaller ones that are stated."""
        small = {name for name in self.stated if 0 < getattr(self.scales, name) < getattr(USUAL, name)}
        scales = replace(self.scales, **{name: getattr(USUAL, name) for name in small})
        return replace(self, scales=scales, stated=self.stated - small)

    def law(self, name: str):
        """From the coordinate of a size, standard normal beforehand, to the size over its scale, and back."""
        if name == "profile_mm" or name in ACCURACY:
            spread = self.profile_spread if name == "profile_mm" else FACTOR
            return lambda y: np.exp(spread * y), lambda ratio: np.log(ratio) / spread
        freedom = FREEDOM_OF_STATED if name in self.stated else FREEDOM
        return (
            lambda y: np.minimum(-stdtrit(freedom, ndtr(-y) / 2), LARGEST),
            lambda ratio: -ndtri(2 * stdtr(freedom, -ratio)),
        )


@dataclass(frozen=True)
class Size:
    """How large one error is."""

    name: str  # the entry of `Noise` or `Systematic`
    scale: float  # of the prior
    low: float  # 95 % between these
    middle: float
    high: float
    told: bool  # whether the data say it rather than the prior


@dataclass(frozen=True)
class Levels:
    """The sizes of all errors, and covariances (6, 6) of δ, mm and rad, that allow for not knowing them."""

    noise: Noise  # the sizes in their middle
    sizes: tuple[Size, ...]
    covariance: np.ndarray  # from what the residuals can show
    unseen: np.ndarray  # what the robot's accuracy over its workspace adds to it
    exact_robot: np.ndarray  # the covariance if the robot did not err


class Likelihood:
    """The linear model at a state, of the poses kept (P,) of each target: its χ² and determinants for any sizes, each
    of which has a coordinate (`Prior.law`)."""

    def __init__(self, problem: Problem, state: State, kept, prior: Prior):
        effects = problem.effects_at(state)
        pairs = zip(effects.rows, problem.linear(state), kept, strict=True)
        grams = [gram_by_pose(rows, linear.columns) * good[:, None, None] for rows, linear, good in pairs]
        n, common = problem.n, len(effects.precision)
        found = problem.information(grams, common)
        values, vectors = np.linalg.eigh(found.normal[0, :n, :n] * problem.units[:, None] * problem.units)
        known = problem.units[:, None] * vectors[:, values > RANK * values[-1]]
        rank = known.shape[1]
        basis = np.zeros((n + common + 1, rank + common + 1))
        basis[:n, :rank], basis[n:, rank:] = known, np.eye(common + 1)
        self.rows = rows_of(
            Information(found.of_errors[0], found.crossed[0] @ basis, basis.T @ found.normal[0] @ basis)
        )
        self.pose = basis[:6, :-1]
        self.precision = np.r_[np.zeros(rank), effects.precision]
        self.count, self.noise, self.sharing = problem.counted(kept), problem.noise, effects.sharing
        self.field, self.prior, scales = None, prior, asdict(prior.scales)
        self.scales = {"profile_mm": scales["profile_mm"]} if prior.profile_spread else {}
        self.scales |= {name: scales[name] for name in effects.sharing.told_apart if scales[name]}

    def without(self, names) -> "Likelihood":
        """The model in which errors of these names do not exist."""
        other = copy(self)
        other.scales = {name: scale for name, scale in self.scales.items() if name not in names}
        return other

    def with_field(self, field: Field, accuracy: dict[str, float]) -> "Likelihood":
        """The model with the robot's accuracy over its workspace, of these scales."""
        other = copy(self)
        other.field, other.scales = field, self.scales | accuracy
        return other

    def rivals(self) -> Iterator["Likelihood"]:
        """Models as likely beforehand as this one, which comes first: without errors that orientations share, without
        errors of poses either; and with the usual errors where less is stated."""
        there = [kind for kind in (SHARED, OF_POSES) if not self.scales.keys().isdisjoint(kind)]
        usual = copy(self)
        usual.prior = self.prior.usual()
        usual.scales = {name: getattr(usual.prior.scales, name) for name in self.scales}
        tried = []
        for model in (self, usual):
            for k in range(len(there) + 1):
                rival = model.without(sum(there[:k], ()))
                if rival.scales not in tried:
                    tried.append(rival.scales)
                    yield rival

    def sizes(self, y) -> dict[str, np.ndarray]:
        """The sizes at coordinates y (d,), or at each of y (S, d)."""
        return {
            name: scale * self.prior.law(name)[0](values)
            for (name, scale), values in zip(self.scales.items(), np.asarray(y).T, strict=True)
        }

    def coordinates(self, sizes: dict[str, float]) -> np.ndarray:
        """Those (d,) of some sizes; of those that are missing or zero, the prior's middle."""
        ratios = {name: sizes.get(name, 0) / scale for name, scale in self.scales.items()}
        return np.array([self.prior.law(name)[1](ratio) if ratio else 0.0 for name, ratio in ratios.items()])

    def noise_of(self, sizes: dict) -> Noise:
        """The noise with these sizes, and no other error of the robot."""
        given = {name: size for name, size in sizes.items() if name not in ACCURACY}
        return replace(self.noise, **(dict.fromkeys(ROBOT, 0.0) | given))

    def at(self, y) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """For sizes at y (S, d): minus twice the logarithm of the posterior density (S,), the covariances (S, 6, 6) of
        the sensor pose, and by how much (S, 6) they would move it."""
        sizes = self.sizes(y)
        noise = self.noise_of(sizes)
        factor = (np.asarray(noise.profile_mm) / self.noise.profile_mm) ** -2.0 * np.ones(len(y))
        levels = [(np.broadcast_to(size, (len(y), 6)), member) for size, member in self.sharing.levels(noise)]
        if not self.field:
            levels[-1] = levels[-1][0], None  # nothing is left but the unknowns
        left = self.rows.without_errors(*levels[0], factor)
        for variances, member in levels[1:]:
            left = remove(left, variances, member)
        if self.field:
            left = self.field.remove(left, *(sizes[name] for name in ACCURACY))
        H, g = left.normal[:, :-1, :-1] + np.diag(self.precision), left.normal[:, :-1, -1:]
        inverse = np.linalg.inv(H)
        step = -(inverse @ g)
        square = left.normal[:, -1, -1] + (np.swapaxes(g, 1, 2) @ step)[:, 0, 0]
        unlikely = square + left.log_determinant - self.count * np.log(factor) + np.linalg.slogdet(H)[1]
        unlikely += (y**2 + np.log(2 * np.pi)).sum(axis=1)
        return unlikely, self.pose @ inverse @ self.pose.T, (self.pose @ step)[..., 0]


def likeliest(model: Likelihood, start: dict[str, float], tolerance: float = ENOUGH) -> np.ndarray:
    """The coordinates (d,) of the likeliest sizes, from those of `start`; ends where a step improves minus twice the
    logarithm of the density by less than `tolerance` of it."""
    y = np.clip(model.coordinates(start), -FARTHEST, FARTHEST)
    if not y.size:
        return y
    steps = np.vstack([np.zeros_like(y), STEP * np.eye(y.size)])

    def with_gradient(y):
        value, *changed = model.at(y + steps)[0]
        return value, (np.array(changed) - value) / STEP

    bounds = [(-FARTHEST, FARTHEST)] * y.size
    ends = {"ftol": tolerance, "gtol": 1e-6}
    return minimize(with_gradient, y, jac=True, method="L-BFGS-B", bounds=bounds, options=ends).x


@dataclass(frozen=True)
class Draws:
    """Sizes that a model allows, with what follows from them."""

    log_weight: np.ndarray  # (S,)
    sizes: dict[str, np.ndarray]  # (S,) each
    square: np.ndarray  # (S, 6, 6) mean square of the error about the state
    spread: dict[str, float]  # of each size's coordinate

    @property
    def weight(self) -> np.ndarray:
        """(S,) of each draw; they sum to one."""
        weight = np.exp(self.log_weight - self.log_weight.max())
        return weight / weight.sum()


def draw(model: Likelihood, likely) -> Draws:
    """Importance sampling about the likeliest coordinates (d,): points of a t law as wide as the posterior is at its
    maximum."""
    d = len(likely)
    z, root = (of_t_law(d), spread_at(model, likely)) if d else (np.zeros((1, 0)), np.zeros((0, 0)))
    y = np.clip(likely + z @ root.T, -FARTHEST, FARTHEST)
    unlikely, covariance, moved = model.at(y)
    proposed = gammaln((TAILS + d) / 2) - gammaln(TAILS / 2) - d / 2 * np.log(TAILS * np.pi)
    proposed = proposed - (TAILS + d) / 2 * np.log1p((z**2).sum(axis=1) / TAILS) - np.linalg.slogdet(root)[1]
    found = Draws(
        log_weight=-unlikely / 2 - proposed - np.log(len(y)),
        sizes={name: np.broadcast_to(size, len(y)) for name, size in model.sizes(y).items()},
        square=covariance + moved[:, :, None] * moved[:, None],
        spread={},
    )
    spread = np.sqrt(np.maximum(found.weight @ y**2 - (found.weight @ y) ** 2, 0))
    return replace(found, spread=dict(zip(model.scales, spread, strict=True)))


@cache
def of_t_law(d: int) -> np.ndarray:
    """Points (DRAWS, d) of a t law, evenly spread: in the unit cube, multiples of the powers of a generalised golden
    ratio (Roberts 2018)."""
    ratio = brentq(lambda x: x ** (d + 2) - x - 1, 1, 2)
    points = (0.5 + np.arange(1, DRAWS + 1)[:, None] * ratio ** -np.arange(1.0, d + 2)) % 1
    return ndtri(points[:, :d]) * np.sqrt(TAILS / chi2_limit(points[:, d:], TAILS))


def spread_at(model: Likelihood, likely) -> np.ndarray:
    """A root (d, d) of the posterior's covariance, from the curvature at its maximum."""
    d, pairs = len(likely), np.array(np.triu_indices(len(likely)))
    first, second = BROAD_STEP * np.eye(d)[pairs]
    corners = np.stack([first + second, first - second, second - first, -first - second])
    values = model.at(likely + corners.reshape(-1, d))[0].reshape(4, -1)
    curvature = np.zeros((d, d))
    mixed = np.array([1, -1, -1, 1]) @ values / (2 * BROAD_STEP) ** 2
    curvature[tuple(pairs)] = curvature[tuple(pairs[::-1])] = mixed / 2  # of half of minus twice the logarithm
    values, vectors = np.linalg.eigh(curvature)
    return vectors / np.sqrt(np.maximum(values, 0.2))


def levels(model: Likelihood, likely, field: Field, accuracy: dict[str, float], tolerance: float = ENOUGH) -> Levels:
    """All sizes that data and prior allow, where `likely` (d,) are the likeliest of the whole model.

    `accuracy`: scales of the robot's accuracy, none to leave it out. `tolerance`: as `likeliest` takes it.
    """
    sizes = model.sizes(likely)
    whole, *rivals = model.rivals()
    tried = [(whole, likely), *((rival, likeliest(rival, sizes, tolerance)) for rival in rivals)]
    unlikely = np.array([m.at(y[None])[0][0] for m, y in tried])
    matters = unlikely < unlikely.min() + NEGLIGIBLE
    matters[0] = True  # the whole model, which tells how well each size is known
    parts = [draw(*tried[k]) for k in np.flatnonzero(matters)]
    log_weight = np.concatenate([part.log_weight for part in parts])
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    covariance = np.tensordot(weight, np.concatenate([part.square for part in parts]), 1)
    drawn = {
        name: np.concatenate([part.sizes.get(name, np.zeros(len(part.log_weight))) for part in parts])
        for name in model.scales
    }
    found = [summary(name, model.scales[name], drawn[name], weight, parts[0].spread[name]) for name in drawn]
    unseen = np.zeros((6, 6))
    if accuracy:
        wide = model.without(SHARED).with_field(field, accuracy)  # the field stands for what orientations share
        drawn = draw(wide, likeliest(wide, sizes, tolerance))
        everywhere = drawn.square + field.common(*(drawn.sizes[name] for name in ACCURACY))
        unseen = positive_part(np.tensordot(drawn.weight, everywhere, 1) - covariance)
        size = drawn.sizes
        found += [summary(name, accuracy[name], size[name], drawn.weight, drawn.spread[name]) for name in accuracy]
    noise = model.noise_of({size.name: size.middle for size in found})
    exact = model.without(ROBOT)
    (exact_robot,) = exact.at(exact.coordinates(asdict(noise))[None])[1]
    return Levels(noise, tuple(found), covariance, unseen, exact_robot)


def summary(name: str, scale: float, values, weight, spread: float) -> Size:
    """Of sizes (S,) and their weights."""
    order = np.argsort(values)
    low, middle, high = np.interp([0.025, 0.5, 0.975], np.cumsum(weight[order]), values[order])
    told = name == "profile_mm" or spread < TOLD
    return Size(name, float(scale), float(low), float(middle), float(high), bool(told))


def positive_part(matrix) -> np.ndarray:
    """The nearest matrix (6, 6) without negative variances, in units of a measurement by hand."""
    values, vectors = np.linalg.eigh(matrix / POSE_UNITS[:, None] / POSE_UNITS)
    return (vectors * np.maximum(values, 0)) @ vectors.T * POSE_UNITS[:, None] * POSE_UNITS
