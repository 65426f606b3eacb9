"""What a calibration found, with its evidence."""

from dataclasses import dataclass, field

import numpy as np

from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import homogeneous
from profilecal.joint.noise import NoiseLevel
from profilecal.joint.observability import Spectrum
from profilecal.joint.problem import Problem
from profilecal.joint.state import State, pose_error


@dataclass(frozen=True)
class Solution:
    """One calibration with its evidence."""

    state: State  # the sensor pose and the targets, a batch of one
    covariance: np.ndarray  # (6, 6) of (ρ, φ) in the sensor's frame, mm and rad: T = T̂ · exp(δ)
    placements: tuple  # a `Target` for each set of observations
    level: NoiseLevel
    chi2: float
    dof: int
    rms_mm: float  # of the residuals kept, less the systematic errors that they suggest
    normalised: tuple  # (P,) for each target: each pose's residual over its expected size
    rejected: tuple  # (P,) bool for each target
    status: str  # "ok", "weak" or "unobservable"
    observability: Spectrum
    messages: tuple  # sentences a person can act on
    converged: bool = True
    unseen: np.ndarray = field(default_factory=lambda: np.zeros((6, 6)))  # what no residual can show, see `joint.field`

    @property
    def covariance_total(self) -> np.ndarray:
        """(6, 6) with what no residual can show: the robot's accuracy over its workspace."""
        return self.covariance + self.unseen

    @property
    def rotation(self) -> np.ndarray:
        """(3, 3) sensor axes in the flange frame (eye-to-hand: in the base frame)."""
        return self.state.rotation[0]

    @property
    def translation(self) -> np.ndarray:
        """(3,) mm."""
        return self.state.translation[0]

    @property
    def noise(self) -> Noise:
        """The sizes of all errors that the solution rests on."""
        return self.level.noise

    @property
    def noise_mm(self) -> float:
        """The scanner's, in x and in z."""
        return float(self.level.noise.profile_mm)

    @property
    def noise_source(self) -> str:
        """ "given" or "estimated"."""
        return "given" if self.level.source == "given" else "estimated"

    @property
    def chi2_per_dof(self) -> float:
        """χ² over the degrees of freedom; 1 where the noise explains the residuals."""
        return self.chi2 / self.dof

    @property
    def kept(self) -> list[np.ndarray]:
        """The poses (P,) of each target that were not rejected."""
        return [~bad for bad in self.rejected]

    @property
    def T_flange_sensor(self) -> np.ndarray:
        """(4, 4) from sensor to flange, mm."""
        return homogeneous(self.rotation, self.translation)

    @property
    def translation_sd_mm(self) -> np.ndarray:
        """(3,) along the sensor's x, y, z."""
        return np.sqrt(np.diag(self.covariance)[:3])

    @property
    def rotation_sd_deg(self) -> np.ndarray:
        """(3,) about the sensor's x, y, z."""
        return np.degrees(np.sqrt(np.diag(self.covariance)[3:]))


def in_mm_deg(covariance) -> np.ndarray:
    """A covariance (6, 6) of δ with the rotation vector in degrees."""
    units = np.r_[1, 1, 1, np.full(3, 180 / np.pi)]
    return covariance * units[:, None] * units


def solution_of(
    problem: Problem, state: State, fit, kept, level: NoiseLevel, found: Spectrum, status: str, messages, converged=True
) -> Solution:
    """The solution that a state (a batch of one) is, with its targets and residuals.

    `fit`: normal equations and residuals by pose there (`descent.Fit` or `problem.Moments`); `kept`: poses (P,) of each
    target that count.
    """
    terms = zip(problem.terms, state.placements, strict=True)
    counted = problem.counted(kept)
    left = problem.without_systematic(state, kept).residuals(state)
    square = sum(float((r[0] ** 2 * good).sum()) for r, good in zip(left, kept, strict=True))
    return Solution(
        state=state,
        covariance=found.covariance,
        placements=tuple(term.target.at(origin[0], axes[0], term.sizes) for term, (origin, axes) in terms),
        level=level,
        chi2=float(fit.normal[0, -1, -1]),
        dof=counted - problem.n,
        rms_mm=float(np.sqrt(square / counted)),
        normalised=tuple(np.sqrt(own[0]) for own in fit.per_pose),
        rejected=tuple(~good for good in kept),
        status=status,
        observability=found,
        messages=tuple(messages),
        converged=bool(converged),
        unseen=level.levels.unseen if level.levels else np.zeros((6, 6)),
    )


def difference(first: Solution, second: Solution) -> tuple[np.ndarray, np.ndarray]:
    """δ (6,) from one sensor pose to another, mm and rad, the first one's frame, and its covariance (6, 6) if their
    errors are independent."""
    delta = pose_error(first.rotation, first.translation, second.rotation, second.translation)
    turn = np.kron(np.eye(2), first.rotation.T @ second.rotation)
    return delta, first.covariance + turn @ second.covariance @ turn.T
