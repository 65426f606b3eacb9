"""The noise that a solution rests on, decided once, before it."""

from dataclasses import asdict, dataclass, fields, replace

import numpy as np

from profilecal.geometry.noise import ROBOT, Noise, Systematic
from profilecal.joint.error_sizes import USUAL, ErrorSizes, Prior

PROFILE_SPREAD = {"given": 0.0, "profiles": 0.5, "residuals": 2.0}  # of the scanner's logarithm
FINEST_MM = 1e-5  # scanner noise: residuals of exact data are rounding


TYPICAL = Systematic(  # where nothing is stated
    scale_percent=0.1,  # linearity as data sheets of laser profile scanners state it, of the measuring range
    shear_percent=0.1,
    bend_mm=0.02,
    tolerance_mm=0.01,
    accuracy_mm=0.3,  # each axis, after the base is fitted; Slamani et al. 2012, Nubiola and Bonev 2013
    accuracy_deg=0.03,
)


@dataclass(frozen=True)
class NoiseLevel:
    """The noise of a solution, and where it is from."""

    noise: Noise
    source: str  # given; residuals: still to be found; profiles: raw profiles
    how: str  # in words
    prior: Prior  # of how large all errors are
    systematic: Systematic = Systematic()  # noqa: RUF009
    found: ErrorSizes | None = None  # the errors as estimated

    @property
    def unknown(self) -> bool:
        """Whether the residuals have to tell the scanner's noise."""
        return self.source in ("residuals", "profiles")

    @property
    def usual_mm(self) -> float:
        """About how large residuals are if all errors are as large as expected, 100 mm from the flange."""
        scales, known = self.prior.scales, self.source != "residuals"
        robot = [
            size if name.endswith("mm") else 100 * np.radians(size)
            for name, size in asdict(scales).items()
            if name in ROBOT
        ]
        return float(np.linalg.norm([known * scales.profile_mm, *robot]))

    @property
    def without_robot(self) -> "NoiseLevel":
        """The same with no errors but the scanner's noise."""
        exact = dict.fromkeys(ROBOT, 0.0)
        prior = replace(self.prior, scales=replace(self.prior.scales, **exact), robot_known=True)
        return replace(self, noise=replace(self.noise, **exact), prior=prior, systematic=Systematic())

    def with_scanner(self, noise_mm: float) -> "NoiseLevel":
        """The same with another scanner's noise."""
        prior = replace(self.prior, scales=replace(self.prior.scales, profile_mm=noise_mm))
        return replace(self, noise=replace(self.noise, profile_mm=noise_mm), prior=prior)


def as_stated(noise: Noise) -> NoiseLevel:
    """The noise to begin with where the robot errs as stated, and the scanner too, or as the residuals tell.

    Raises ValueError for a noise that is none.
    """
    if noise.profile_mm < 0:
        raise ValueError(f"profile_mm is {noise.profile_mm}; expected a standard deviation, 0 if unknown")
    source, how = ("given", "as given") if noise.profile_mm else ("residuals", "from the residuals")
    noise = replace(noise, profile_mm=noise.profile_mm or 1.0)
    return NoiseLevel(noise, source, how, Prior(noise, profile_spread=PROFILE_SPREAD[source], robot_known=True))


def prior_from(stated: dict[str, float], features_mm: float = 0.0, shared_mm: float = 0.0) -> NoiseLevel:
    """The noise to begin with where the robot's errors are to be estimated. What is `stated` of them, entries of
    `Noise` and `Systematic`, is the scale of what is believed beforehand, 0 that there is none; the rest is as usual.

    `features_mm`: the noise of features that raw profiles themselves show, 0 where there are none. `shared_mm`: what
    features of one orientation err together; it counts as the robot's.
    """
    robot = {name: stated.get(name, getattr(USUAL, name)) for name in ROBOT}
    robot["group_position_mm"] = float(np.hypot(robot["group_position_mm"], shared_mm))
    systematic = Systematic(**{f.name: stated.get(f.name, getattr(TYPICAL, f.name)) for f in fields(Systematic)})
    noise = Noise(
        profile_mm=features_mm or stated.get("profile_mm", 0.0) or 1.0, steering_mm=stated.get("steering_mm", 0)
    )
    source, how = "residuals", "from the residuals"
    if features_mm:
        source, how = "profiles", "of the features that the profiles show"
    elif stated.get("profile_mm"):
        source, how = "given", "as given"
    prior = Prior(replace(noise, **robot), frozenset(ROBOT) & stated.keys(), PROFILE_SPREAD[source])
    return NoiseLevel(noise, source, how, prior, systematic)
