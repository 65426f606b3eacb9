"""Is a sensor pose right? Applied to a scan that was not used to find it, it must give the target's known shape."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import chi2

from profilecal.calibrate.observe import LEAST_POSES, observe
from profilecal.geometry.checks import check_rotations
from profilecal.geometry.poses import carry, rotations
from profilecal.scan.scan import Scan, ScanError

DRAWS = 200  # of the stated covariance
BELIEVED = 3.0  # standard deviations


@dataclass(frozen=True)
class Length:
    """A known length of a target, held against what was found."""

    name: str
    found_mm: float
    nominal_mm: float
    sd_mm: float  # to expect, from the stated covariance

    @property
    def as_expected(self) -> bool:
        return abs(self.found_mm - self.nominal_mm) < BELIEVED * self.sd_mm


@dataclass(frozen=True)
class Verification:
    """What a scan says of a sensor pose: the size and the straightness of its target, found and to be expected."""

    shape: str  # what was fitted
    rms_mm: float  # of the points' distances from it
    expected_rms_mm: float  # from the noise and the stated covariance, 95 % of the cases below
    lengths: tuple[Length, ...]
    points: int

    @property
    def as_expected(self) -> bool:
        """Whether the stated noise and covariance explain what was found."""
        return all(length.as_expected for length in self.lengths) and self.rms_mm < self.expected_rms_mm


def read_pose(path) -> tuple[np.ndarray, np.ndarray, float, bool]:
    """From what `profilecal calibrate --json` printed: T (4, 4) mm, covariance (6, 6) of δ in mm and rad, noise in mm,
    and whether it is eye-to-hand. Raises ScanError."""
    try:
        found = json.loads(Path(path).read_text(encoding="utf-8"))
        to_hand = "T_base_sensor" in found
        T = np.asarray(found["T_base_sensor" if to_hand else "T_flange_sensor"], dtype=float)
        units = np.r_[1, 1, 1, np.full(3, np.pi / 180)]
        covariance = np.asarray(found["covariance"], dtype=float) * units[:, None] * units
        noise = float(found["noise_mm"])
    except OSError as error:
        raise ScanError(f"{path}: {error.strerror}") from error
    except (ValueError, TypeError, KeyError) as error:
        raise ScanError(f"{path}: not what `profilecal calibrate --json` prints ({error!r})") from error
    if T.shape != (4, 4) or covariance.shape != (6, 6) or not np.isfinite([*T.flat, *covariance.flat, noise]).all():
        raise ScanError(f"{path}: holds no sensor pose; expected a 4x4 transform and a 6x6 covariance")
    try:
        check_rotations(f"{path}: the sensor pose", T[None, :3, :3])
    except ValueError as error:
        raise ScanError(str(error).replace("[0]", "")) from error
    if np.abs(T[3] - [0, 0, 0, 1]).max() > 0:
        raise ScanError(f"{path}: the last row of the sensor pose is {T[3].tolist()}; expected [0, 0, 0, 1]")
    values = np.linalg.eigvalsh(covariance)
    if not np.allclose(covariance, covariance.T) or values[0] < -1e-9 * values[-1] or values[-1] <= 0:
        raise ScanError(f"{path}: holds no covariance; expected a symmetric, positive 6x6 matrix")
    return T, covariance, noise, to_hand


def verify(scan: Scan, T, covariance, noise_mm: float, rng: np.random.Generator) -> Verification:
    """Fit the target's shape to all points of a scan, carried to one frame by the sensor pose T (4, 4), mm.

    What to expect comes from poses drawn from the stated covariance (6, 6), mm and rad, about T.

    Raises ScanError for a scan that shows too little of its target.
    """
    seen = observe(scan, LEAST_POSES)
    R, t = scan.base_flange(seen.poses)
    there = np.isfinite(seen.points).all(axis=-1)
    pose, _ = np.nonzero(there)
    x, z = seen.points[there].T
    points = np.stack([x, np.zeros_like(x), z], axis=-1)

    def fitted(rotation, translation):
        """Distances of the points (n,) from the shape that fits them, and its lengths."""
        in_base = carry(R[pose], t[pose], points @ rotation.T + translation)
        origin, axes, sizes = scan.target.fit(in_base)
        return scan.target.at(origin, axes, sizes).distance(in_base), sizes

    left, sizes = fitted(T[:3, :3], T[:3, 3])
    delta = rng.multivariate_normal(np.zeros(6), covariance, DRAWS)
    shifts, turned = T[:3, 3] + delta[:, :3] @ T[:3, :3].T, T[:3, :3] @ rotations(delta[:, 3:])
    drawn = [fitted(turn, shift) for turn, shift in zip(turned, shifts, strict=True)]
    added = [np.mean((other - left) ** 2) for other, _ in drawn]
    # noise in x and in z (and an arc's in radius too), or across a surface only
    seen_twice = 2 if scan.target.points or scan.measured == "arcs" else 1
    noise = noise_mm**2 * chi2.isf(0.05, seen_twice * len(left)) / len(left)
    sds = np.std([other for _, other in drawn], axis=0) + noise_mm / np.sqrt(len(left))
    measures = zip(scan.measures.items(), sizes, sds, strict=True) if sizes else ()
    return Verification(
        shape=scan.target.shape,
        rms_mm=float(np.sqrt(np.mean(left**2))),
        expected_rms_mm=float(np.sqrt(np.percentile(added, 95) + noise)),
        lengths=tuple(Length(name, float(found), value, float(sd)) for (name, value), found, sd in measures),
        points=len(left),
    )


def to_text(found: Verification) -> str:
    """What `profilecal verify` prints."""
    lines = [f"{found.shape} through {found.points} points"]
    for length in found.lengths:
        off = abs(length.found_mm - length.nominal_mm)
        lines.append(
            f"{length.name:<15}{length.found_mm:.3f} mm, {off:.3f} from {length.nominal_mm:g}; "
            f"one standard deviation to expect is {length.sd_mm:.2g}"
        )
    lines += [
        f"residuals      {found.rms_mm:.3g} mm rms; up to {found.expected_rms_mm:.3g} is to be expected",
        "verdict        the stated uncertainty explains what was found"
        if found.as_expected
        else "verdict        more is wrong than the stated uncertainty explains: robot, target, or calibration",
    ]
    return "\n".join(lines)
