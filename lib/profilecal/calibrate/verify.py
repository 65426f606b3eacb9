"""Is a sensor pose right? Applied to a scan that was not used to find it, it must give the target's known shape."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import chi2

from profilecal.calibrate.observe import observations
from profilecal.geometry.checks import check_rotations
from profilecal.geometry.fitting import fit_line, fit_sphere
from profilecal.geometry.poses import rotations
from profilecal.scan.scan import Scan, ScanError

DRAWS = 200  # of the stated covariance


BELIEVED = 3.0  # standard deviations


@dataclass(frozen=True)
class Verification:
    """What a scan says of a sensor pose: the size and the straightness of its target, found and to be expected."""

    shape: str  # what was fitted
    rms_mm: float  # of the points' distances from it
    expected_rms_mm: float  # from the noise and the stated covariance, 95 % of the cases below
    radius_mm: float | None  # found; None where the target has none
    nominal_mm: float | None
    radius_sd_mm: float | None  # of the radius, from the stated covariance
    points: int

    @property
    def as_expected(self) -> bool:
        """Whether the stated noise and covariance explain what was found."""
        size = self.radius_mm is None or abs(self.radius_mm - self.nominal_mm) < BELIEVED * self.radius_sd_mm
        return size and self.rms_mm < self.expected_rms_mm


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
    target = observations(scan)
    poses, seen = target.poses, target.points
    least = {"ball": 4, "disk": 3, "plane": 3, "edge": 3, "point": 2}[scan.kind]
    if len(poses) < least:
        raise ScanError(f"{scan.title}: the target was found from {len(poses)} poses; expected {least} or more")
    R, t = scan.R_base_flange[poses], scan.T_base_flange[poses]
    if scan.mount == "eye-to-hand":
        R = R.transpose(0, 2, 1)
        t = -np.einsum("nab,nb->na", R, t)
    rows, _ = np.nonzero(np.isfinite(seen).all(axis=-1))
    x, z = seen[np.isfinite(seen).all(axis=-1)].T
    points = np.stack([x, np.zeros_like(x), z], axis=-1)

    def residuals(rotation, translation):
        return FITS[scan.kind](np.einsum("nab,nb->na", R[rows], points @ rotation.T + translation) + t[rows])

    left, radius = residuals(T[:3, :3], T[:3, 3])
    delta = rng.multivariate_normal(np.zeros(6), covariance, DRAWS)
    turned = rotations(delta[:, 3:])
    drawn = [residuals(T[:3, :3] @ turned[k], T[:3, 3] + T[:3, :3] @ delta[k, :3]) for k in range(DRAWS)]
    added = np.array([np.mean((other - left) ** 2) for other, _ in drawn])
    # noise in x and in z (and an arc's in radius too), or across a surface only
    seen_twice = 2 if scan.kind in ("edge", "disk", "point") or scan.measured == "arcs" else 1
    noise = noise_mm**2 * chi2.isf(0.05, seen_twice * len(left)) / len(left)
    expected = np.sqrt(np.percentile(added, 95) + noise)
    return Verification(
        SHAPES[scan.kind],
        float(np.sqrt(np.mean(left**2))),
        float(expected),
        float(radius) if radius is not None else None,
        scan.radius,
        float(np.std([r for _, r in drawn]) + noise_mm / np.sqrt(len(left))) if radius is not None else None,
        len(left),
    )


def _sphere(points):
    found = fit_sphere(points)
    return np.linalg.norm(points - found.centre, axis=1) - found.radius, found.radius


def _line(points):
    found = fit_line(points)
    offset = points - found.point
    return np.linalg.norm(offset - (offset @ found.direction)[:, None] * found.direction, axis=1), None


def _plane(points):
    centre = points.mean(axis=0)
    return (points - centre) @ np.linalg.svd(points - centre, full_matrices=False)[2][2], None


def _rim(points):
    heights, _ = _plane(points)
    centre = points.mean(axis=0)
    axes = np.linalg.svd(points - centre, full_matrices=False)[2][:2]
    flat = (points - centre) @ axes.T
    A = np.column_stack([2 * flat, np.ones(len(flat))])
    a, b, c = np.linalg.lstsq(A, np.sum(flat**2, axis=1), rcond=None)[0]
    radius = np.sqrt(c + a * a + b * b)
    return np.hypot(heights, np.hypot(flat[:, 0] - a, flat[:, 1] - b) - radius), radius


def _spot(points):
    return np.linalg.norm(points - points.mean(axis=0), axis=1), None


FITS = {"ball": _sphere, "edge": _line, "plane": _plane, "disk": _rim, "point": _spot}


SHAPES = {"ball": "sphere", "edge": "straight line", "plane": "plane", "disk": "circle", "point": "one point"}


def to_text(found: Verification) -> str:
    """What `profilecal verify` prints."""
    lines = [f"{found.shape} through {found.points} points"]
    if found.radius_mm is not None:
        off = abs(found.radius_mm - found.nominal_mm)
        lines.append(
            f"radius         {found.radius_mm:.3f} mm, {off:.3f} from {found.nominal_mm:g}; "
            f"one standard deviation to expect is {found.radius_sd_mm:.2g}"
        )
    lines += [
        f"residuals      {found.rms_mm:.3g} mm rms; up to {found.expected_rms_mm:.3g} is to be expected",
        "verdict        the stated uncertainty explains what was found"
        if found.as_expected
        else "verdict        more is wrong than the stated uncertainty explains: robot, target, or calibration",
    ]
    return "\n".join(lines)
