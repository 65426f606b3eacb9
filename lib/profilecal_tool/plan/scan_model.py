"""What a scan of planned poses would show, and what a calibration would state of it: by
its own linear model.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy import ndarray
from numpy.random import Generator

from profilecal.calibration.observe import points_of
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

DRAWS = 20  # of how wrong the guess is
NOWHERE = np.empty((0, 3, 3)), np.empty((0, 3))  # no poses


@dataclass(frozen=True)
class ScanModel(Setup):
    """A sensor, a target and a robot, as they are believed to be."""

    scanner: Scanner
    noise: Noise  # that predictions count with
    systematic: Systematic = field(default_factory=Systematic)
    to_hand: bool = False
    measured: str = "profiles"
    # of what a pose shows, over the noise's profile_mm², as `Observations` has it of
    # one
    covariance: ndarray | None = None
    guess: Guess | None = None  # None: all this is known well enough
    count: int = 40  # points of a curve that a pose gives
    limits: Limits = field(default_factory=Limits)
    # of the robot's smooth errors, as `Problem` takes them; None: as poses have them
    smooth: Known | None = None
    # poses R (P, 3, 3), T (P, 3) that are there already
    before: Frames = NOWHERE
    # whether `calibrate` has something to say against the scan that all this is from
    doubted: bool = False

    def in_base(self, R: ndarray, T: ndarray) -> Frames:
        """Poses of the flange in the base (P, 3, 3), (P, 3), of poses as the joint
        solution has them; or the other way round.
        """
        return inverse(R, T) if self.to_hand else (R, T)

    def elsewhere(self, rng: Generator) -> "ScanModel":
        """The same with everything anywhere within the guess's margins."""
        setup = self.guess.setup(self.target.kind, self.target.sizes, rng)
        return replace(self, **vars(setup))

    @property
    def beside_mm(self) -> float:
        """How much around a point of the target raw profiles must show, mm."""
        return self.target.beside_mm * (self.measured == "profiles")

    def points_seen(self, R_view: ndarray, T_view: ndarray, count: int) -> ndarray:
        """What a perfect scanner at sensor frames (P, 3, 3), (P, 3) sees, (P, m, 2):
        `count` points of a curve; on a face, which fills the view, from side to side.

        A ray r of the view has x = r (h + g z), where the half width h at z = 0 grows
        by g. It meets the line z = a + b x, in which the scan plane meets the face, at

            z = (a + b r h) / (1 - b r g).
        """
        if len(self.target.shifts) > 1:
            return self.target.points_seen(R_view, T_view, count)
        line = self.target.line_at(R_view, T_view, np.arange(2.0))
        rays, half = np.linspace(-0.9, 0.9, count), self.scanner.half_width(0.0)
        growth = self.scanner.half_width(1.0) - half
        slope = np.diff(line[..., 1]) * rays
        z = (line[:, :1, 1] + slope * half) / (1 - slope * growth)
        return np.stack([rays * self.scanner.half_width(z), z], axis=-1)

    def middle_seen(self, R_view: ndarray, T_view: ndarray) -> ndarray:
        """The middle one of the points seen, (P, 2)."""
        seen = self.points_seen(R_view, T_view, 5)
        return seen[:, seen.shape[1] // 2]

    def observed(self, R: ndarray, T: ndarray) -> Observations:
        """What a perfect scanner sees from poses, as a calibration takes it."""
        planes, are_circles = self.planes(R, T), self.measured == "arcs"
        if are_circles:
            points = points_of("arcs", self.target.meet(*planes))
        else:
            points = self.points_seen(*planes, self.count)
        covariance = self.covariance
        if covariance is not None:
            covariance = covariance.repeat(len(T), axis=1)
        return Observations(
            self.target.kind,
            R[None],
            T[None],
            points[None],
            self.target.sizes,
            rotation_groups(R),
            self.to_hand,
            covariance,
            are_circles,
        )

    def linear(
        self, R: ndarray, T: ndarray, before: Frames = NOWHERE, **in_motion: Any
    ) -> tuple[Problem, LinearModel, ndarray]:
        """The problem of a calibration from poses, its linear model, and the variances
        (1 + k,) of the errors in that. `before`: those of an earlier scan, in which the
        target has a place of its own. `in_motion`: log, times and groups of
        `Observations`.
        """
        scans = [poses for poses in (before, (R, T)) if len(poses[1])]
        seen = [replace(self.observed(*poses), **in_motion) for poses in scans]
        problem = Problem(seen, self.noise, self.systematic, known_smooth=self.smooth)
        state = replace(self.state, placements=self.state.placements * len(scans))
        sizes = self.noise.of_robot | {"jitter_ms": self.noise.jitter_ms}
        variances = np.square([1.0, *sizes.values()])
        return problem, problem.model(state, [*sizes]), variances


def each_alone(model: LinearModel, variances: ndarray) -> ndarray:
    """What each profile by itself says of the unknowns, (profiles, q, q), of a robot
    without smooth errors of unknown size; by variances (1 + k,), the scanner's 1.
    """
    A, rest = model.Y[..., :-1], model.rest[..., :-1]
    return A.mT @ np.linalg.solve(model.own(variances), A) + rest.mT @ rest


def joined(*poses: Frames) -> Frames:
    """Poses and further ones together."""
    R, T = map(np.concatenate, zip(*poses, strict=True))
    return R, T


def largest_sd(covariance: ndarray) -> ndarray:
    """The largest standard deviations (2,), of a covariance whose first six entries are
    of a pose: of the translation in any direction, and of the rotation about any axis.
    """
    blocks = covariance[:3, :3], covariance[3:6, 3:6]
    return np.sqrt(np.linalg.norm(blocks, 2, axis=(1, 2)))


@dataclass(frozen=True)
class Prediction(Spectrum):
    """How well poses will determine the sensor pose: the spectrum of the covariance
    that `calibrate` will state.
    """

    mm: float  # the largest standard deviation of the translation in any direction
    deg: float  # and of the rotation about any axis
    poses: int
    delay_sd_s: float | None = None  # in motion: of the delay between both clocks
    # least and largest (mm, deg) if the guess is wrong
    between: Sequence[ndarray] = ()

    def lacks(self, wanted_sd: Sequence[float]) -> float:
        """How many times as large as wanted, mm and degrees, they are."""
        return max(self.mm / wanted_sd[0], self.deg / wanted_sd[1])


def predict(
    model: ScanModel,
    R: ndarray,
    T: ndarray,
    rng: Generator | None = None,
    **in_motion: Any,
) -> Prediction:
    """Predict how well flange poses (P, 3, 3), (P, 3) will determine the sensor pose,
    with those of the scan that was before.

    Without bends of smooth errors, which widen the regions of planned scans by a tenth.
    With `rng`: and how well if the guess is wrong by anything within its margins.
    `in_motion`: as `ScanModel.linear` takes it.
    """
    problem, linear, variances = model.linear(R, T, model.before, **in_motion)
    posterior = linear.posterior(variances[None])
    (covariance,), n, clock = posterior.covariance, problem.n, problem.clock
    is_open = spectrum(posterior.normal[0, :n, :n], problem.units).is_open
    known = of_covariance(covariance[:6, :6], is_open)
    mm, rad = largest_sd(known.covariance)
    worst = mm, np.degrees(rad), len(problem.counts)
    delay_sd_s = clock and np.sqrt(covariance[clock, clock])
    between = ()
    if rng and model.guess:
        found = [predict(model.elsewhere(rng), R, T, **in_motion) for _ in range(DRAWS)]
        sizes = [(one.mm, one.deg) for one in found]
        between = [*np.quantile(sizes, [0, 1], axis=0)]
    return Prediction(*vars(known).values(), *worst, delay_sd_s, between)
