"""What a calibration found, with its evidence."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy import ndarray

from profilecal.geometry.noise import ESTIMATED, SMOOTH, Noise
from profilecal.geometry.observability import Spectrum
from profilecal.geometry.poses import homogeneous
from profilecal.joint.error_sizes import ErrorSizes
from profilecal.joint.linear_model import LinearModel
from profilecal.joint.prior import Perturbation, Prior
from profilecal.joint.problem import Problem
from profilecal.joint.smooth import SmoothErrors, shifting
from profilecal.targets.state import State
from profilecal.targets.target import Target


@dataclass(frozen=True)
class Solution:
    """One calibration with its evidence."""

    state: State  # the sensor pose and the targets, a batch of one
    # (6, 6) of δ = (ρ, φ) in the sensor's frame, mm and rad: T = T̂ · exp(δ)
    covariance: ndarray
    prior: Prior  # of the errors
    error_sizes: ErrorSizes
    chi2: float
    dof: int
    rms_mm: float  # of the residuals kept, less the systematic errors that they suggest
    # (P,) for each target: each pose's residual over its expected size
    normalised: tuple
    rejected: tuple  # (P,) bool for each target
    status: str  # "ok", "weak" or "unobservable"
    observability: Spectrum
    messages: tuple  # sentences a person can act on
    problem: Problem

    @property
    def covariance_total(self) -> ndarray:
        """The covariance (6, 6) of the true sensor pose, with two errors that no
        residual shows, both of the mean variance of smooth errors: one error of the
        flange at all poses, of the size estimated for smooth errors; and the part of
        the smooth errors that a change of the mount takes up (`smooth`), the first six
        rows of `steps`.

        A flange that is shifted by s and turned by ψ takes along the sensor, which is
        at a, in the sensor's frame: ρ = s + ψ × a, φ = ψ. Eye-to-hand, the sensor's own
        place has the error, and a is zero.
        """
        sizes = self.error_sizes
        if SMOOTH not in sizes.of_robot:
            return self.covariance
        # from the place that has the error to the sensor, in the sensor's frame
        arm = np.zeros(3)
        if not self.problem.to_hand:
            arm = self.rotation.T @ self.translation
        by_axis = np.repeat([1, self.smooth.ratio], 3)
        moved = np.hstack([shifting(arm) * by_axis, self.smooth.steps[:6]])
        return self.covariance + sizes.mean_v[-1] * moved @ moved.T

    @property
    def placements(self) -> tuple[Target, ...]:
        """The targets where they stand."""
        terms = zip(self.problem.terms, self.state.placements, strict=True)
        return tuple(
            term.target.at(origin[0], axes[0], term.sizes)
            for term, (origin, axes) in terms
        )

    @property
    def noise(self) -> Noise:
        """The medians of the sizes of all errors."""
        medians = {size.name: size.middle for size in self.error_sizes.sizes}
        return self.problem.noise.of_sizes(dict.fromkeys(ESTIMATED, 0.0) | medians)

    @cached_property
    def smooth(self) -> SmoothErrors:
        """The robot's smooth errors at the poses kept."""
        return self.problem.smooth(self.state).keeping(np.concatenate(self.kept))

    def model(self, tried: Sequence[Perturbation] = ()) -> LinearModel:
        """The linear model of the poses kept at the solution, with errors `tried` of
        which nothing is known beforehand.
        """
        model = self.problem.model(self.state, [*self.error_sizes.of_robot], tried)
        return model.keeping(np.concatenate(self.kept))

    @property
    def known_of_all(self) -> tuple[ndarray, ndarray]:
        """Mean and covariance of a step from the solution, of the unknowns, the errors
        considered, and the coefficients of smooth errors. The mean is zero of the
        unknowns and the clock, which the solution has at their mean. All regions are
        enlarged as that of the sensor pose is.
        """
        sizes, problem = self.error_sizes, self.problem
        posterior = self.model().posterior(sizes.mean_v[None])
        mean = sizes.mean.copy()
        mean[: problem.n] = 0
        if problem.clock is not None:
            mean[problem.clock] = 0
        covariance = sizes.covariance / sizes.enlarged
        mean, covariance = posterior.with_smooth(mean, covariance)
        # smooth errors stand first in the model's columns, and last here
        order = np.roll(np.arange(len(mean)), -posterior.m)
        return mean[order], sizes.enlarged * covariance[np.ix_(order, order)]

    @property
    def delay_s(self) -> float | None:
        """The robot's clock less the scanner's; None where nothing moved."""
        delays = (s.delay_s for s in self.problem.observations if s.moving.any())
        return next(delays, None)

    @property
    def delay_sd_s(self) -> float:
        """The standard deviation of `delay_s`, beforehand DELAY_S unless the delay was
        given; only where something moved.
        """
        clock = self.problem.clock
        return float(np.sqrt(self.error_sizes.covariance[clock, clock]))

    @property
    def rotation(self) -> ndarray:
        """(3, 3) sensor axes in the flange frame; eye-to-hand, in the base frame."""
        return self.state.rotation[0]

    @property
    def translation(self) -> ndarray:
        """(3,) mm, the sensor's origin in the frame of `rotation`."""
        return self.state.translation[0]

    @property
    def noise_mm(self) -> float:
        """The scanner's noise, in x and in z."""
        return float(self.noise.profile_mm)

    @property
    def noise_source(self) -> str:
        """Whether the scanner's noise was "given" or "estimated"."""
        return "given" if self.prior.source == "given" else "estimated"

    @property
    def chi2_per_dof(self) -> float:
        """χ² over the degrees of freedom; 1 where the noise explains the residuals."""
        return self.chi2 / self.dof

    @property
    def kept(self) -> list[ndarray]:
        """The poses (P,) of each target that were not rejected."""
        return [~bad for bad in self.rejected]

    @property
    def pose(self) -> ndarray:
        """(4, 4) mm, the sensor in the flange frame; eye-to-hand, in the base frame."""
        return homogeneous(self.rotation, self.translation)
