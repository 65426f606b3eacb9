"""One calibration for every target: the sensor pose and all placements in one maximum-likelihood step.

Unknown are the sensor pose (6) and where each target is (edge 4, disk 5, ball 3, plane 3, point 3). A residual is an
observed point minus where the scan plane meets the target, in the scan plane. Each target file offers `residual` and
its derivatives in the *sensor* frame; everything else is the same for all of them and is written once, here.

The sensor pose is perturbed as T · exp(δ), δ = (ρ, φ) in the sensor's frame: a point at p there moves to
p - ρ + p × φ, a direction d to d + d × φ. Every function takes a batch of problems along the leading axis.
"""

from dataclasses import dataclass

import numpy as np

from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import homogeneous
from profilecal.joint.observability import Spectrum
from profilecal.joint.state import State, pose_error


@dataclass(frozen=True)
class Solution:
    """One calibration with its evidence."""

    rotation: np.ndarray  # (3, 3) sensor axes in the flange frame (eye-to-hand: in the base frame)
    translation: np.ndarray  # (3,) mm
    covariance: np.ndarray  # (6, 6) of (ρ, φ) in the sensor's frame, mm and rad: T = T̂ · exp(δ)
    placements: tuple  # a target object (Edge, Disk, …) for each set of observations
    noise_mm: float
    noise_source: str  # "given" or "estimated"
    noise_how: str  # in words
    chi2: float
    dof: int
    rms_mm: float  # of the residuals kept
    normalised: tuple  # (P,) for each target: each pose's residual over its expected size
    rejected: tuple  # (P,) bool for each target
    status: str  # "ok", "weak" or "unobservable"
    observability: Spectrum
    messages: tuple  # sentences a person can act on
    converged: bool
    noise: Noise  # all of it, as it was used

    @property
    def chi2_per_dof(self) -> float:
        return self.chi2 / self.dof

    @property
    def state(self) -> State:
        """The sensor pose and the targets, a batch of one."""
        pairs = [(np.asarray(v, dtype=float) for v in vars(target).values()) for target in self.placements]
        placements = ((p[None], (rest[0] if rest and rest[0].ndim else np.zeros(3))[None]) for p, *rest in pairs)
        return State(self.rotation[None], self.translation[None], tuple(placements))

    @property
    def kept(self) -> list[np.ndarray]:
        """The poses (P,) of each target that were not rejected."""
        return [~bad for bad in self.rejected]

    @property
    def T_flange_sensor(self) -> np.ndarray:
        return homogeneous(self.rotation, self.translation)

    @property
    def translation_sd_mm(self) -> np.ndarray:
        return np.sqrt(np.diag(self.covariance)[:3])

    @property
    def rotation_sd_deg(self) -> np.ndarray:
        return np.degrees(np.sqrt(np.diag(self.covariance)[3:]))

    @property
    def covariance_mm_deg(self) -> np.ndarray:
        """The covariance with the rotation vector in degrees."""
        units = np.r_[1, 1, 1, np.full(3, 180 / np.pi)]
        return self.covariance * units[:, None] * units


def difference(first: Solution, second: Solution) -> tuple[np.ndarray, np.ndarray]:
    """δ (6,) from one sensor pose to another, mm and rad, the first one's frame, and its covariance (6, 6) if their
    errors are independent."""
    delta = pose_error(first.rotation, first.translation, second.rotation, second.translation)
    turn = np.kron(np.eye(2), first.rotation.T @ second.rotation)
    return delta, first.covariance + turn @ second.covariance @ turn.T


def normalised_square(covariance, error) -> np.ndarray:
    """Errors (..., 6) squared over their covariances (..., 6, 6): follows χ² with 6 degrees of freedom if honest."""
    return np.einsum("...i,...i", error, np.linalg.solve(covariance, error[..., None])[..., 0])
