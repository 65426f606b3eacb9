"""What is believed of the errors before a solution: how large each may be, and which
are known.

Nobody knows the scanner's and the target's systematic errors, but everybody knows about
how large they can be. They are considered: the answer gives way to them as far as they
are likely (Schmidt 1966). Those of the robot are only tested
(`calibrate.plausibility`).

The size of a robot's error follows a half-t law (Gelman 2006), whose scale is what the
user states or what robots usually do. What is stated may be far too small, a data
sheet's repeatability for instance: its law has the longer tail.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import gammaln, ndtr, stdtrit

from profilecal.geometry.noise import ROBOT, Noise, Systematic

# of robots, where nothing is stated: scales of the prior, the same at a pose and at an
# orientation
USUAL = Noise(
    position_mm=0.05,
    orientation_deg=0.02,
    group_position_mm=0.05,
    group_orientation_deg=0.02,
    repeatability_mm=0.02,
    repeatability_deg=0.005,
)
TYPICAL = Systematic(  # where nothing is stated
    # linearity as data sheets of laser profile scanners state it, of the measuring
    # range
    scale_percent=0.1,
    shear_percent=0.1,
    bend_mm=0.02,
    tolerance_mm=0.01,
    # each axis, after the base is fitted; Slamani et al. 2012, Nubiola and Bonev 2013
    accuracy_mm=0.3,
    accuracy_deg=0.03,
)
FINEST_MM = 1e-5  # scanner noise: residuals of exact data are rounding
FREEDOM = 3.0  # degrees of the half-t law; 1 of what is stated
# of the scanner's noise: in words, and the spread of its logarithm beforehand
SOURCES = {
    "given": ("as given", 0.0),
    "profiles": ("of the features that the profiles show", 0.5),
    "residuals": ("from the residuals", 2.0),
}


@dataclass(frozen=True)
class Prior:
    """What is known beforehand of how large errors are. Each size has a coordinate y,
    standard normal beforehand.
    """

    scales: Noise
    stated: frozenset[str] = frozenset()  # by the user; the other scales are usual ones
    source: str = "given"  # of the scanner's noise
    robot_known: bool = False  # the robot's errors are as large as their scales
    systematic: Systematic = Systematic()  # noqa: RUF009

    @property
    def how(self) -> str:
        """Where the scanner's noise is from, in words."""
        return SOURCES[self.source][0]

    @property
    def profile_spread(self) -> float:
        """Of the logarithm of the scanner's noise; 0: it is known."""
        return SOURCES[self.source][1]

    @property
    def usual_mm(self) -> float:
        """About how large residuals are if all errors are as large as expected, 100 mm
        from the flange.
        """
        sizes = [self.scales.profile_mm * (self.source != "residuals")]
        for name, size in self.scales.of_robot.items():
            sizes.append(size if name.endswith("mm") else 100 * np.radians(size))
        return float(np.linalg.norm(sizes))

    @property
    def without_robot(self) -> "Prior":
        """The same with no errors but the scanner's noise, and the robot's accuracy,
        which no residual shows.
        """
        exact = replace(self.scales, **dict.fromkeys(ROBOT, 0.0))
        known = Systematic(
            accuracy_mm=self.systematic.accuracy_mm,
            accuracy_deg=self.systematic.accuracy_deg,
        )
        return replace(self, scales=exact, robot_known=True, systematic=known)

    def with_scanner(self, noise_mm: float) -> "Prior":
        """The same with another scanner's noise."""
        return replace(self, scales=replace(self.scales, profile_mm=noise_mm))

    def law(self, names: Sequence[str]) -> "Law":
        """Of the sizes of the scanner's noise, over its scale, and of the robot's
        errors of these names.
        """
        spreads = [
            0.0 if self.robot_known else 1.0 if name in self.stated else FREEDOM
            for name in names
        ]
        scales = [1.0, *(getattr(self.scales, name) for name in names)]
        return Law(np.array(scales), np.array([self.profile_spread, *spreads]))

    def names(self, distinguishable) -> list[str]:
        """The errors of the robot that there are, entries of `Noise`: all if known,
        else the distinguishable ones.
        """
        return [
            name
            for name in self.scales.of_robot
            if self.robot_known or name in distinguishable
        ]

    @property
    def usual(self) -> "Prior | None":
        """The same with the usual scales in place of smaller ones that are stated, if
        there are any.
        """
        small = {
            name
            for name in self.stated
            if 0 < getattr(self.scales, name) < getattr(USUAL, name)
        }
        scales = replace(self.scales, **{name: getattr(USUAL, name) for name in small})
        return (
            replace(self, scales=scales, stated=self.stated - small) if small else None
        )


@dataclass(frozen=True)
class Law:
    """The prior law of 1 + k sizes, the scanner's first."""

    scales: np.ndarray  # (1 + k,)
    # (1 + k,) of the scanner's logarithm; degrees of freedom of the others; 0: known
    spreads: np.ndarray

    @cached_property
    def free(self) -> np.ndarray:
        """Which (d,) of the sizes are not known."""
        return np.flatnonzero(self.spreads)

    def variances(self, y) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The squares (S, 1 + k) of the sizes at coordinates y (S, d), and their first
        and second derivatives (S, d).

        A size over its scale is t with P(|T| > t) = Φ(-y), T of f degrees of freedom;
        the scanner's is exp(f y).
        """
        f, scale = self.spreads[self.free], self.scales[self.free]
        # smaller ones: SciPy's quantile of them has the wrong sign
        chance = ndtr(-np.minimum(y, 8.0))
        t = np.minimum(-stdtrit(f, chance / 2), 100.0)  # a larger error is a mistake
        density = np.exp(
            gammaln((f + 1) / 2) - gammaln(f / 2) - (f + 1) / 2 * np.log1p(t**2 / f)
        ) / np.sqrt(f * np.pi)
        first = np.exp(-(y**2) / 2) / np.sqrt(2 * np.pi) / (2 * density)
        second = first * ((f + 1) * t * first / (f + t**2) - y)
        growth = np.exp(f * y)
        of_scanner = growth, f * growth, f**2 * growth
        t, first, second = scale * np.where(
            self.free == 0, of_scanner, (t, first, second)
        )
        v = np.tile(self.scales**2, (len(y), 1))
        v[:, self.free] = t**2
        return v, 2 * t * first, 2 * (first**2 + t * second)


@dataclass(frozen=True)
class Perturbation:
    """One error, which moves points, positions of the robot, or a length by so much for
    one unit of its size.
    """

    words: str  # with a place for the size, and [one word|another] for its sign
    unit: float  # what the size is to be multiplied by, for the words
    prior: str = ""  # the entry of `Systematic` that says how large it can be
    # of points x and z (...): by how much both are wrong, mm
    points: Callable | None = None
    # of flange positions (P, 3) in the base: by how much they are wrong, mm
    positions: Callable = np.zeros_like
    length: str = ""  # of the target


def of_scanner() -> list[Perturbation]:
    """Scales of the profiles, x that grows with z, and a bend."""
    words, scale = (
        "the profiles' {} were too [large|small] by {{:.2g}} %",
        "scale_percent",
    )
    return [
        Perturbation(words.format("x"), 100, scale, points=lambda x, z: (x, 0 * z)),
        Perturbation(words.format("z"), 100, scale, points=lambda x, z: (0 * x, z)),
        Perturbation(
            "the profiles' x grew with z by {:+.2g} %",
            100,
            "shear_percent",
            points=lambda x, z: (z, 0 * z),
        ),
        Perturbation(
            "the profiles were bent by {:+.2g} mm, 50 mm from the middle",
            1,
            "bend_mm",
            points=lambda x, z: (0 * x, (x / 50) ** 2),
        ),
    ]


def of_target(targets: Sequence) -> list[Perturbation]:
    """Wrong lengths."""
    names = dict.fromkeys(name for target in targets for name in target.lengths)
    words = "the {} was too [large|small] by {{:.2g}} mm"
    return [
        Perturbation(words.format(name), 1, "tolerance_mm", length=name)
        for name in names
    ]


def considered(
    targets: Sequence, prior: Systematic
) -> list[tuple[Perturbation, float]]:
    """What may be wrong and how large that is, a standard deviation in its own unit;
    without what is 0.
    """
    errors = [*of_scanner(), *of_target(targets)]
    return [
        (error, size)
        for error in errors
        if (size := getattr(prior, error.prior) / error.unit)
    ]


def as_stated(noise: Noise) -> Prior:
    """The prior where the robot errs as stated, and the scanner too, or as the
    residuals tell. Raises ValueError.
    """
    if noise.profile_mm < 0:
        raise ValueError(
            f"profile_mm is {noise.profile_mm}; expected a standard deviation, 0 if unknown"
        )
    source = "given" if noise.profile_mm else "residuals"
    return Prior(
        replace(noise, profile_mm=noise.profile_mm or 1.0),
        source=source,
        robot_known=True,
    )


def prior_from(
    stated: dict[str, float], features_mm: float = 0.0, shared_mm: float = 0.0
) -> Prior:
    """The prior where the robot's errors are to be estimated. What is `stated` of them,
    entries of `Noise` and `Systematic`, is the scale of what is believed, 0 that there
    is none; the rest is as usual. `features_mm`: the noise that raw profiles themselves
    show, 0 where there are none; `shared_mm`: what features of one orientation err
    together, which counts as the robot's.
    """
    robot = {name: stated.get(name, getattr(USUAL, name)) for name in ROBOT}
    robot["group_position_mm"] = float(np.hypot(robot["group_position_mm"], shared_mm))
    systematic = Systematic(
        **{name: stated.get(name, usual) for name, usual in vars(TYPICAL).items()}
    )
    given_mm = stated.get("profile_mm", 0.0)
    scales = Noise(
        features_mm or given_mm or 1.0,
        steering_mm=stated.get("steering_mm", 0.0),
        **robot,
    )
    source = "profiles" if features_mm else "given" if given_mm else "residuals"
    return Prior(
        scales, frozenset(ROBOT) & stated.keys(), source, systematic=systematic
    )
