"""What is known before a scan, and what poses will be worth: the information that their
profiles will hold, by the linear model that the calibration will solve.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy import ndarray

from profilecal.calibration.observe import three_points
from profilecal.geometry.noise import Noise, Systematic
from profilecal.geometry.observability import Spectrum, of_covariance, spectrum
from profilecal.geometry.poses import Frames, inverse, rotation_groups
from profilecal.joint.linear_model import LinearModel
from profilecal.joint.problem import Problem
from profilecal.joint.smooth import Known
from profilecal.simulation.robot import Scanner
from profilecal.simulation.scene import Setup
from profilecal.targets.observations import Observations
from profilecal_tool.plan.specification import Guess, Limits

GUESSES = 20  # draws of how wrong the guess is: they show most of the range


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
    limits: Limits = Limits()  # noqa: RUF009
    # of the robot's smooth errors, as `Problem` takes them; None: as poses have them
    smooth: Known | None = None
    # whether `calibrate` has something to say against the scan that all this is from
    doubted: bool = False

    def in_base(self, R: ndarray, T: ndarray) -> Frames:
        """Flange poses (P, 3, 3), (P, 3) in the base, or back; eye-to-hand, those of a
        model are of the base in the flange frame.
        """
        return inverse(R, T) if self.to_hand else (R, T)

    def elsewhere(self, rng: np.random.Generator) -> "ScanModel":
        """The same where the guess is wrong by anything within its margins."""
        setup = self.guess.setup(self.target.kind, self.sizes, rng)
        return replace(self, **vars(setup))

    @property
    def beside_mm(self) -> float:
        """How much around a point of the target raw profiles must show, mm."""
        return self.target.beside_mm if self.measured == "profiles" else 0.0

    def points_seen(self, R_view: ndarray, T_view: ndarray, count: int) -> ndarray:
        """What a perfect scanner at sensor frames (P, 3, 3), (P, 3) sees of the target.

        Returns (P, m, 2), mm, `count` points of a curve; NaN where it is missed. On a
        face they reach across the field of view, but for a tenth at the sides, which
        features leave out.

        A ray at the fraction r of the half width, which is h at z = 0 and grows by g,
        meets the line n_x x + n_z z = d where x = r (h + g z).
        """
        is_face = len(self.target.shifts) == 1  # only a shift across it changes it
        if not is_face:
            return self.target.points_seen(R_view, T_view, count)
        origin, axes = self.target.frame
        normal = axes[:, 2]
        n = normal @ R_view
        distance = (origin - T_view) @ normal
        half, farther = self.scanner.half_width(np.array([0.0, 1.0]))
        ray = np.linspace(-0.9, 0.9, count)
        n_ray = n[:, :1] * ray
        z = distance[:, None] - n_ray * half
        z = z / (n[:, 2:] + n_ray * (farther - half))
        return np.stack([ray * self.scanner.half_width(z), z], axis=-1)

    def middle_seen(self, R_view: ndarray, T_view: ndarray) -> ndarray:
        """The middle (P, 2), mm, of what is seen from sensor frames."""
        points = self.points_seen(R_view, T_view, 5)
        return points[:, points.shape[1] // 2]

    def in_view(self, R: ndarray, T: ndarray) -> ndarray:
        """Whether the middle of what is seen from flange poses (P, 3, 3), (P, 3) is in
        the field of view, (P,).
        """
        x, z = self.middle_seen(*self.planes(R, T)).T
        in_range = (self.scanner.near <= z) & (z <= self.scanner.far)
        return in_range & (np.abs(x) <= self.scanner.half_width(z))

    def observed(self, R: ndarray, T: ndarray) -> Observations:
        """What the scanner will see of the target from flange poses (P, 3, 3), (P, 3).

        In mm, NaN where it misses the target; of an arc three points that stand for it.
        """
        planes = self.planes(R, T)
        are_circles = self.measured == "arcs"
        if are_circles:
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
            are_circles,
        )

    def linear(
        self, R: ndarray, T: ndarray, **in_motion: Any
    ) -> tuple[Problem, LinearModel, ndarray]:
        """The least-squares problem of what is seen from flange poses, its linear
        model, and the variances (1 + k,) of the errors that this counts with.

        `in_motion`: the log, times and group of poses that the robot goes through.
        """
        seen = replace(self.observed(R, T), **in_motion)
        problem = Problem([seen], self.noise, self.systematic, known_smooth=self.smooth)
        sizes = self.noise.of_robot
        if problem.clock is not None:
            sizes |= {"jitter_ms": self.noise.jitter_ms}
        variances = np.array([1.0, *sizes.values()]) ** 2
        return problem, problem.model(self.state, list(sizes)), variances


def information(model: ScanModel, R: ndarray, T: ndarray) -> ndarray:
    """What flange poses (P, 3, 3), (P, 3) tell of the unknowns and the shared errors.

    Returns (q, q), for the unknowns and then for what is wrong at all poses, the
    robot's errors integrated out.
    """
    _, linear, variances = model.linear(R, T)
    # the last row and column are of the residuals themselves
    return linear.posterior(variances[None]).normal[0, :-1, :-1]


def largest_sd(covariance: ndarray) -> ndarray:
    """The largest standard deviations (2,), of a covariance (6, 6) of a pose: of the
    translation in any direction, and of the rotation about any axis.
    """
    blocks = covariance[:3, :3], covariance[3:, 3:]
    return np.sqrt([np.linalg.norm(block, 2) for block in blocks])


@dataclass(frozen=True)
class Prediction:
    """How well poses will determine the sensor pose."""

    spectrum: Spectrum  # of the covariance that `calibrate` will state
    poses: int
    # smallest and largest (`mm`, `deg`) if the guess is wrong
    between: tuple = ()
    # in motion: standard deviation of the delay between both clocks, s
    delay_sd_s: float | None = None

    @property
    def covariance(self) -> ndarray:
        """(6, 6) of δ = (ρ, φ) in the sensor's frame, mm and rad."""
        return self.spectrum.covariance

    @property
    def mm(self) -> float:
        """The largest standard deviation of the translation in any direction."""
        return largest_sd(self.covariance)[0]

    @property
    def deg(self) -> float:
        """The largest standard deviation of the rotation about any axis."""
        return np.degrees(largest_sd(self.covariance)[1])

    def lacks(self, wanted_sd: Sequence[float]) -> float:
        """How many times as large as wanted, mm and degrees, they are."""
        return max(self.mm / wanted_sd[0], self.deg / wanted_sd[1])


def predict(
    model: ScanModel,
    R: ndarray,
    T: ndarray,
    rng: np.random.Generator | None = None,
    **in_motion: Any,
) -> Prediction:
    """Predict how well flange poses (P, 3, 3), (P, 3) will determine the sensor pose.

    Without bends of smooth errors, which widen the regions of planned scans by a tenth.
    With `rng`: and how well if the guess is wrong by anything within its margins.
    `in_motion`: as `ScanModel.linear` takes it.
    """
    problem, linear, variances = model.linear(R, T, **in_motion)
    posterior = linear.posterior(variances[None])
    (covariance,), n = posterior.covariance, problem.n
    rank = spectrum(posterior.normal[0, :n, :n], problem.units).rank
    known = of_covariance(covariance[:6, :6], rank, n)
    clock = problem.clock  # None where nothing moves
    delay_sd_s = clock and np.sqrt(covariance[clock, clock])
    found = Prediction(known, len(T), delay_sd_s=delay_sd_s)
    if rng is None or model.guess is None:
        return found
    others = [predict(model.elsewhere(rng), R, T, **in_motion) for _ in range(GUESSES)]
    sizes = np.array([(other.mm, other.deg) for other in others])
    return replace(found, between=(sizes.min(axis=0), sizes.max(axis=0)))
