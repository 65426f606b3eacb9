"""What is known before a scan, and what poses will be worth.

Their worth is the information that their profiles will hold.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy import ndarray

from profilecal.calibration.observe import three_points
from profilecal.geometry.noise import Noise, Systematic
from profilecal.geometry.observability import Spectrum, spectrum
from profilecal.geometry.poses import rotation_groups
from profilecal.joint.problem import Problem
from profilecal.scan.scan import ScanError
from profilecal.simulation.robot import Scanner
from profilecal.simulation.scene import Setup
from profilecal.targets.observations import Observations
from profilecal_tool.plan.specification import Guess

GUESSES = 20  # draws of how wrong the guess is: they show most of the range


@dataclass(frozen=True)
class Limits:
    """Where the robot may go."""

    # of the flange's positions in the base frame, mm
    low: tuple[float, ...] = (-np.inf,) * 3
    high: tuple[float, ...] = (np.inf,) * 3
    # of the direction of view against looking at the target squarely
    tilt_deg: float = 30.0
    # about the direction of view
    spin_deg: float = 45.0
    # how far from the guess an edge, a rod or a face is seen, to either side
    extent_mm: float = 50.0
    # zones x, y, z, radius: where neither flange nor sensor may be
    avoid: tuple[tuple[float, ...], ...] = ()

    def __post_init__(self) -> None:
        for axis, low, high in zip("xyz", self.low, self.high, strict=True):
            if low >= high:
                raise ScanError(
                    f"the box is empty along {axis}: "
                    f"low is {low:g} and high is {high:g} mm"
                )


@dataclass(frozen=True)
class ScanModel(Setup):
    """A sensor, a target and a robot, as they are believed to be."""

    scanner: Scanner
    # the standard deviations that predictions count with
    noise: Noise
    systematic: Systematic = Systematic()  # noqa: RUF009
    to_hand: bool = False
    measured: str = "profiles"
    # of what a pose shows, over the noise's profile_mm², as `Observations` has it
    covariance: ndarray | None = None
    # where all this is from, with margins; None: known well enough
    guess: Guess | None = None
    # points of a curve that a pose gives
    count: int = 40
    limits: Limits = Limits()

    def elsewhere(self, rng: np.random.Generator) -> "ScanModel":
        """The same where the guess is wrong by anything within its margins."""
        if self.guess is None:
            return self
        setup = self.guess.setup(self.target.kind, self.sizes, rng)
        return replace(self, **vars(setup))

    @property
    def beside_mm(self) -> float:
        """How much around a point of the target raw profiles must show, mm."""
        return self.target.beside_mm if self.measured == "profiles" else 0.0

    def points_seen(self, R_view: ndarray, T_view: ndarray, count: int) -> ndarray:
        """What a perfect scanner at sensor frames (P, 3, 3), (P, 3) sees of the target.

        Returns (P, m, 2), mm, `count` points of a curve; NaN where it is missed.
        """
        points = self.target.points_seen(R_view, T_view, count)
        is_face = len(self.target.shifts) == 1
        return self.across_view(points, count) if is_face else points

    def middle_seen(self, R_view: ndarray, T_view: ndarray) -> ndarray:
        """The middle (P, 2), mm, of what is seen from sensor frames."""
        points = self.points_seen(R_view, T_view, 5)
        return points[:, points.shape[1] // 2]

    def in_view(self, R: ndarray, T: ndarray) -> ndarray:
        """Whether flange poses (P, 3, 3), (P, 3) have the target in view, (P,).

        They have if the middle of what is seen is in the field of view.
        """
        x, z = self.middle_seen(*self.planes(R, T)).T
        scanner = self.scanner
        in_range = (scanner.near <= z) & (z <= scanner.far)
        return in_range & (np.abs(x) <= scanner.half_width(z))

    def across_view(self, points: ndarray, count: int) -> ndarray:
        """Points (P, count, 2) across the field of view on lines through (P, m, 2).

        They reach from one side to the other, but for a tenth at the sides, which
        features leave out. The line z = d + s x meets the sides where ±x is the half
        width at its depth, h(z) = h(d) + (h(d + s) - h(d)) x: at -h/(1 + g) and
        h/(1 - g), where g is the growth h(d + s) - h(d).
        """
        (first_x, last_x), (first_z, last_z) = points[:, [0, -1]].T
        slope = (last_z - first_z) / (last_x - first_x)
        depth = first_z - slope * first_x
        half, farther = 0.9 * self.scanner.half_width(np.array([depth, depth + slope]))
        growth = farther - half
        x = np.linspace(-half / (1 + growth), half / (1 - growth), count, axis=1)
        return np.stack([x, depth[:, None] + slope[:, None] * x], axis=-1)

    def observed(self, R: ndarray, T: ndarray) -> Observations:
        """What the scanner will see of the target from flange poses (P, 3, 3), (P, 3).

        In mm, NaN where it misses the target; of an arc three points that stand for it.
        """
        planes = self.planes(R, T)
        if self.measured == "arcs":
            points = three_points(self.target.meet(*planes))
        else:
            points = self.points_seen(*planes, self.count)
        covariance = self.covariance
        if covariance is not None:
            covariance = np.broadcast_to(covariance, (1, len(R), *covariance.shape))
        return Observations(
            self.target.kind,
            R[None],
            T[None],
            points[None],
            self.sizes,
            rotation_groups(R),
            self.to_hand,
            covariance,
            self.measured == "arcs",
        )

    def problem(self, R: ndarray, T: ndarray, **in_motion: Any) -> Problem:
        """The least-squares problem of what is seen from flange poses; `in_motion`: the
        log, times and group of those that the robot goes through.
        """
        seen = replace(self.observed(R, T), **in_motion)
        return Problem([seen], self.noise, self.systematic)


def information(
    model: ScanModel,
    R: ndarray,
    T: ndarray,
    each: bool = False,
    problem: Problem | None = None,
) -> ndarray:
    """What flange poses (P, 3, 3), (P, 3) tell of the unknowns and the shared errors.

    Returns (q, q), for the unknowns and then for what is wrong at all poses, the
    robot's errors integrated out. `each`: of each pose by itself, (P, q, q); where all
    have orientations of their own, these add up to the whole. `problem`: that of these
    poses, if it is known.
    """
    problem = problem or model.problem(R, T)
    sizes = model.noise.of_robot
    if problem.clock is not None:
        sizes |= {"jitter_ms": model.noise.jitter_ms}
    variances = np.array([1.0, *sizes.values()]) ** 2
    linear = problem.model(model.state, list(sizes))
    # the last row and column are of the residuals themselves
    if each:
        return linear.alone(variances)[:, :-1, :-1]
    return linear.posterior(variances[None]).normal[0, :-1, :-1]


def marginal(information: ndarray, n: int) -> ndarray:
    """What information matrices (..., N, N) say of the first n unknowns alone.

    The others are not known any better: A - B C⁻¹ Bᵀ of the blocks A, B; Bᵀ, C.
    """
    known = information[..., :n, :n]
    across = information[..., :n, n:]
    others = information[..., n:, n:]
    return known - across @ np.linalg.solve(others, across.mT)


def largest_sd(covariance: ndarray) -> list[float]:
    """The largest standard deviations, of a covariance (6, 6) of a pose.

    That of the translation in any direction, and that of the rotation about any axis.
    """
    blocks = covariance[:3, :3], covariance[3:, 3:]
    return [float(np.sqrt(np.linalg.norm(block, 2))) for block in blocks]


@dataclass(frozen=True)
class Prediction:
    """How well poses will determine the sensor pose."""

    spectrum: Spectrum
    poses: int
    # smallest and largest (`mm`, `deg`) if the guess is wrong
    between: tuple = ()
    # in motion: standard deviation of the delay between both clocks, s
    delay_sd_s: float | None = None

    @property
    def covariance(self) -> ndarray:
        """(6, 6) of δ = (ρ, φ) in the sensor's frame, mm and rad.

        It is the one that `calibrate` will state.
        """
        return self.spectrum.covariance

    @property
    def mm(self) -> float:
        """The largest standard deviation of the translation in any direction."""
        return largest_sd(self.covariance)[0]

    @property
    def deg(self) -> float:
        """The largest standard deviation of the rotation about any axis."""
        return np.degrees(largest_sd(self.covariance)[1])


def predict(
    model: ScanModel,
    R: ndarray,
    T: ndarray,
    rng: np.random.Generator | None = None,
    **in_motion: Any,
) -> Prediction:
    """Predict how well flange poses (P, 3, 3), (P, 3) will determine the sensor pose.

    With `rng`: and how well if the guess is wrong by anything within its margins.
    `in_motion`: as `ScanModel.problem` takes it.
    """
    problem = model.problem(R, T, **in_motion)
    units = problem.units
    considered = np.array([*problem.considered.values()])
    precision = np.r_[0 * units, considered**-2.0]
    total = information(model, R, T, problem=problem) + np.diag(precision)
    pose_information = marginal(total, len(units))
    prediction = Prediction(spectrum(pose_information, units), len(T))
    if problem.clock is not None:
        variances = np.diag(np.linalg.pinv(total, hermitian=True))
        sd_s = float(np.sqrt(variances[problem.clock]))
        prediction = replace(prediction, delay_sd_s=sd_s)
    if rng is None or model.guess is None:
        return prediction

    draws = [model.elsewhere(rng) for _ in range(GUESSES)]
    others = [predict(other, R, T, **in_motion) for other in draws]
    sizes = np.array([(other.mm, other.deg) for other in others])
    return replace(prediction, between=(sizes.min(axis=0), sizes.max(axis=0)))
