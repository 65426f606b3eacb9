"""What is believed of the errors before a solution: how large each may be, and which
are known.

Nobody knows the scanner's and the target's systematic errors, but everybody knows about
how large they can be. They are considered: the answer gives way to them as far as they
are likely (Schmidt 1966). Those of the robot are only tested
(`calibration.plausibility`).

The size of a robot's error follows a half-t law (Gelman 2006), whose scale is what the
user states or what robots usually do. What is stated may be far too small, a data
sheet's repeatability for instance: its law has the longer tail.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy import ndarray
from scipy.special import ndtr, stdtrit

from profilecal.geometry.log import DELAY_S
from profilecal.geometry.noise import (
    ESTIMATED,
    ROBOT,
    SMOOTH,
    Noise,
    Systematic,
    in_mm,
)
from profilecal.geometry.poses import pose_error
from profilecal.targets.observations import Observations

# Scales of the prior where nothing is stated of the robot; the same at a pose and at an
# orientation.
USUAL = Noise(
    position_mm=0.05,
    orientation_deg=0.02,
    group_position_mm=0.05,
    group_orientation_deg=0.02,
    repeatability_mm=0.02,
    repeatability_deg=0.005,
    jitter_ms=0.2,
    # arms that are not calibrated, each axis, after the base is fitted (Slamani et al.
    # 2012, Nubiola and Bonev 2013); so err joints by 0.035° and lengths by 0.2 mm
    accuracy_mm=0.3,
    accuracy_deg=0.03,
)
# Systematic errors where nothing is stated.
TYPICAL = Systematic(
    # linearity over the measuring range, as data sheets of profile scanners state it
    scale_percent=0.1,
    shear_percent=0.1,
    bend_mm=0.02,
    tolerance_mm=0.01,
)
# The scanner's noise is at least this: residuals of exact data are rounding.
FINEST_MM = 1e-5
# Degrees of freedom of the half-t law; what the user states has STATED_FREEDOM, for the
# longer tail.
FREEDOM = 3.0
STATED_FREEDOM = 1.0
# The spread of the logarithm of the scanner's noise, by where that is from: stated by
# the user, seen in the profiles' features, or left to the residuals.
SPREADS = {"given": 0.0, "profiles": 0.5, "residuals": 2.0}
# The spread of the logarithm of smooth errors: two of three arms are within a factor of
# two.
SMOOTH_SPREAD = 0.7


@dataclass(frozen=True)
class Mount:
    """What is known of the sensor pose beforehand."""

    rotation: ndarray  # (3, 3)
    translation: ndarray  # (3,) mm
    sd: ndarray  # (6,) of δ = (ρ, φ), mm and rad; infinite: nothing

    def normal(self, rotation: ndarray, translation: ndarray, n: int) -> ndarray:
        """What it says at sensor poses (B, 3, 3), (B, 3), as normal equations (B, n +
        1, n + 1) of n unknowns, the sensor pose first.

        A step x that leads to the mount is x = δ, so the residual is (x - δ) / sd.
        """
        delta = pose_error(rotation, translation, self.rotation, self.translation)
        rows = np.zeros((len(delta), 6, n + 1))
        rows[:, range(6), range(6)] = 1 / self.sd
        rows[:, :, n] = -delta / self.sd
        return rows.mT @ rows


@dataclass(frozen=True)
class Prior:
    """What is known beforehand of how large errors are.

    Each size that is not known has a coordinate y, standard normal beforehand (`Law`).
    """

    scales: Noise
    stated: frozenset[str] = frozenset()  # by the user; the other scales are usual ones
    source: str = "given"  # of the scanner's noise, one of SPREADS
    # the robot's errors are as large as their scales, but for smooth ones, of which
    # only stated ones are
    robot_known: bool = False
    systematic: Systematic = Systematic()  # noqa: RUF009
    mount: Mount | None = None

    @property
    def profile_spread(self) -> float:
        """The spread of the logarithm of the scanner's noise; 0 where it is known."""
        return SPREADS[self.source]

    @property
    def usual_mm(self) -> float:
        """About how large residuals are if all errors are as large as expected, 100 mm
        from the flange.
        """
        robot = self.scales.of_robot.items()
        sizes = [size * in_mm(name) for name, size in robot]
        if self.source != "residuals":
            sizes.append(self.scales.profile_mm)
        return float(np.linalg.norm(sizes))

    @property
    def without_robot(self) -> "Prior":
        """The same with no errors but the scanner's noise and smooth ones: systematic
        errors are left out, too.
        """
        exact = replace(self.scales, **dict.fromkeys((*ROBOT, "jitter_ms"), 0.0))
        # so that `law` leaves the size of smooth errors free, although robot_known
        stated = self.stated - {SMOOTH}
        return replace(
            self,
            scales=exact,
            stated=stated,
            robot_known=True,
            systematic=Systematic(),
        )

    def with_scanner(self, noise_mm: float) -> "Prior":
        """The same with another scanner's noise."""
        return replace(self, scales=replace(self.scales, profile_mm=noise_mm))

    def law(self, names: Sequence[str]) -> "Law":
        """The law of the size of the scanner's noise, over its scale, and of the sizes
        of the robot's errors of these names.
        """
        scales = np.array([1.0, *(getattr(self.scales, name) for name in names)])
        spreads, freedoms = np.zeros((2, len(scales)))
        spreads[0] = self.profile_spread
        for number, name in enumerate(names, 1):
            is_stated = name in self.stated
            if self.robot_known and (is_stated or name != SMOOTH):
                continue
            if name == SMOOTH:
                spreads[number] = SMOOTH_SPREAD
            else:
                freedoms[number] = STATED_FREEDOM if is_stated else FREEDOM
        return Law(scales, spreads, freedoms)

    def names(self, distinguishable: Sequence[str]) -> list[str]:
        """The errors of the robot that a model has, entries of `Noise`, of those whose
        scale is not zero: smooth errors always; the distinguishable ones; and all of
        ROBOT, if the robot is known.
        """
        there = {SMOOTH, *distinguishable, *(ROBOT if self.robot_known else ())}
        return [n for n in ESTIMATED if n in there and getattr(self.scales, n)]

    @property
    def usual(self) -> "Prior | None":
        """The same with the usual scales in place of smaller ones that are stated, if
        there are any.
        """
        usual = {
            name: getattr(USUAL, name)
            for name in self.stated
            if 0 < getattr(self.scales, name) < getattr(USUAL, name)
        }
        if not usual:
            return None
        scales = replace(self.scales, **usual)
        return replace(self, scales=scales, stated=self.stated - usual.keys())


@dataclass(frozen=True)
class Law:
    """The prior law of 1 + k sizes, the scanner's first. Those that have neither a
    spread nor degrees of freedom are known.
    """

    scales: ndarray  # (1 + k,)
    spreads: ndarray  # (1 + k,) of logarithms that are normal; 0: another law
    freedoms: ndarray  # (1 + k,) of half-t laws; 0: another law

    @cached_property
    def free(self) -> ndarray:
        """Which (d,) of the sizes are not known."""
        return np.flatnonzero(self.spreads + self.freedoms)

    def variances(self, y: ndarray) -> ndarray:
        """The variances v (S, 1 + k), squares of the sizes, at coordinates y (S, d).

        An error of the robot, of scale σ, has the size σ t. By P(|T| > t) = Φ(-y), t is
        as likely to be exceeded by |T|, of Student's law of f degrees of freedom, as y
        by a standard normal variable. The scanner's noise and smooth errors, of spread
        s, have the size σ exp(s y).
        """
        of_all = np.zeros((len(y), len(self.scales)))
        of_all[:, self.free] = y
        sizes = self.scales * np.exp(self.spreads * of_all)
        by_t = self.freedoms > 0
        # SciPy's quantile of smaller chances has the wrong sign
        chance = ndtr(-np.minimum(of_all[:, by_t], 8.0))
        t = -stdtrit(self.freedoms[by_t], chance / 2)
        sizes[:, by_t] *= np.minimum(t, 100.0)  # a larger error is a mistake
        return sizes**2


@dataclass(frozen=True)
class Perturbation:
    """One error of a certain size, which moves points, positions of the robot, or a
    length: by how much, for one unit of its size.
    """

    words: str  # with a place for one of the signs, and for the size
    unit: float  # what the size is to be multiplied by, for the words
    signs: tuple[str, str] = ("large", "small")  # of a positive and a negative size
    prior: str = ""  # the entry of `Systematic` that says how large it can be
    # of points x and z (...): by how much both are wrong, mm
    points: Callable | None = None
    # of flange positions (P, 3) in the base: by how much they are wrong, mm
    positions: Callable = np.zeros_like
    # a target's kind, its sizes, mm, and the number of the one that is wrong
    length: tuple[str, tuple[float, ...], int] | None = None
    # of times (P,) by the scanner's clock: by how much they are wrong, s
    clock: Callable | None = None
    # of one that is considered, and never another: answers in files know it by this
    name: str = ""


Points = tuple[ndarray, ndarray]  # x and z


def scaled_x(x: ndarray, z: ndarray) -> Points:
    """An error of x that grows with x, by one."""
    return x, 0 * z


def scaled_z(x: ndarray, z: ndarray) -> Points:
    """An error of z that grows with z, by one."""
    return 0 * x, z


def sheared(x: ndarray, z: ndarray) -> Points:
    """An error of x that grows with z, by one."""
    return z, 0 * z


def bend(x: ndarray, z: ndarray) -> Points:
    """An error of z as if profiles were bent by 1 mm, 50 mm from the middle."""
    return 0 * x, (x / 50) ** 2


# The scanner's errors: scales of the profiles, x that grows with z, and a bend.
OF_SCANNER = [
    Perturbation(
        "the profiles' x were too {} by {} %",
        100,
        prior="scale_percent",
        points=scaled_x,
        name="x scale",
    ),
    Perturbation(
        "the profiles' z were too {} by {} %",
        100,
        prior="scale_percent",
        points=scaled_z,
        name="z scale",
    ),
    Perturbation(
        "the profiles' x {} with z by {} %",
        100,
        ("grew", "shrank"),
        "shear_percent",
        points=sheared,
        name="shear",
    ),
    Perturbation(
        "the profiles were bent {} the scanner by {} mm, 50 mm from the middle",
        1,
        ("away from", "towards"),
        "bend_mm",
        points=bend,
        name="bend",
    ),
]


# What all times in motion have in common: the robot's clock less the scanner's.
DELAY = Perturbation(
    "the scanner's clock was {} by {} ms",
    1000,
    ("behind", "ahead"),
    clock=np.ones_like,
    name="delay",
)
CLOCK_DRIFT = 5e-5  # of quartz clocks, s/s


def of_clocks(observations: Sequence[Observations]) -> dict[Perturbation, float]:
    """The errors of the times of what was seen in motion, if anything was, and how
    large each may be, a standard deviation: a delay, and a delay that grows from the
    middle of all times.
    """
    moving = [seen for seen in observations if seen.moving.any()]
    times = [seen.times.ravel() for seen in moving if seen.times is not None]
    if not times:
        return {}
    every = np.concatenate(times)
    middle = (np.nanmin(every) + np.nanmax(every)) / 2
    growing = Perturbation(
        "the scanner's clock was too {} by {} ppm",
        1e6,
        ("slow", "fast"),
        clock=partial(np.add, -middle),  # not a lambda: results are pickled
        name="drift",
    )
    sd_s = 1e-6 if moving[0].delay_known else DELAY_S
    return {DELAY: sd_s, growing: CLOCK_DRIFT}


def of_target(observations: Sequence[Observations]) -> list[Perturbation]:
    """The targets' errors: wrong sizes. Targets of one kind and of the same sizes
    are taken for one that several scans saw; each other target is wrong by itself.
    """
    known = {
        (seen.kind, seen.sizes): seen.target.size_names
        for seen in observations
        if seen.sizes
    }
    errors = []
    for (kind, sizes), names in known.items():
        target = f"{kind} {' x '.join(f'{size:.12g}' for size in sizes)}"
        for number, (name, mm) in enumerate(zip(names, sizes, strict=True)):
            which = f"{kind}'s {name} of {mm:g} mm" if len(known) > 1 else name
            errors.append(
                Perturbation(
                    f"the {which} was too {{}} by {{}} mm",
                    1,
                    prior="tolerance_mm",
                    length=(kind, sizes, number),
                    name=f"{name} of {target}",
                )
            )
    return errors


def considered(
    observations: Sequence[Observations], prior: Systematic
) -> dict[Perturbation, float]:
    """The systematic errors that may be, and how large each may be, a standard
    deviation in its own unit; without those of size 0.
    """
    errors = [*OF_SCANNER, *of_target(observations)]
    sizes = {error: getattr(prior, error.prior) / error.unit for error in errors}
    return {error: size for error, size in sizes.items() if size}


def as_stated(noise: Noise) -> Prior:
    """The prior where the robot errs as stated, and the scanner as stated or, if
    nothing is, as the residuals tell.
    """
    source = "given" if noise.profile_mm else "residuals"
    # 1 mm stands for noise that is not known
    scales = replace(noise, profile_mm=noise.profile_mm or 1.0)
    return Prior(scales, frozenset(ESTIMATED), source, robot_known=True)


def prior_from(stated: dict[str, float], features_mm: float = 0.0) -> Prior:
    """The prior where the robot's errors are to be estimated.

    What is `stated` of them, entries of `Noise` and `Systematic`, is the scale of what
    is believed, 0 that there is no such error; the rest is as usual. `features_mm`: the
    noise that raw profiles themselves show, 0 where there are none.
    """
    robot = {name: stated.get(name, getattr(USUAL, name)) for name in ESTIMATED}
    # smooth errors of orientations, left out, are to those of positions as usual; both
    # are counted in mm, of which those of orientations alone need some
    as_usual = USUAL.accuracy_deg * (robot[SMOOTH] / USUAL.accuracy_mm)
    deg = robot["accuracy_deg"] = stated.get("accuracy_deg", as_usual)
    robot[SMOOTH] = robot[SMOOTH] or FINEST_MM * (deg > 0)
    errors = {name: stated.get(name, usual) for name, usual in vars(TYPICAL).items()}
    given_mm = stated.get("profile_mm", 0.0)
    scales = Noise(
        features_mm or given_mm or 1.0,  # 1 mm stands for noise that is not known
        steering_mm=stated.get("steering_mm", 0.0),
        **robot,
    )
    source = "profiles" if features_mm else "given" if given_mm else "residuals"
    return Prior(
        scales,
        frozenset(ESTIMATED) & stated.keys(),
        source,
        systematic=Systematic(**errors),
    )
