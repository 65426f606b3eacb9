"""What `profilecal calibrate` prints for people."""

import numpy as np

from profilecal.calibrate.calibration import Calibration
from profilecal.geometry.poses import xyz_angles_from_rotation
from profilecal.joint.error_sizes import ErrorSizes, Size
from profilecal.joint.solution import in_mm_deg

PLACES = {
    "at each visit": ("repeatability_mm", "repeatability_deg"),
    "at each pose": ("position_mm", "orientation_deg"),
    "shared by the poses of an orientation": ("group_position_mm", "group_orientation_deg"),
}
WORTH_A_WORD = 1.25  # times as large a standard deviation


def to_text(found: Calibration) -> str:
    """What `profilecal calibrate` prints for people."""
    s, lines = found.solution, [f"status         {found.status}"]
    if found.status != "unobservable":
        W, P, R = np.degrees(xyz_angles_from_rotation(s.rotation))
        W = (W + 180) % 360 - 180
        tx, ty, tz = s.translation
        accuracy = f"{s.level.systematic.accuracy_mm:g} mm and {s.level.systematic.accuracy_deg:g}°"
        lines += [
            f"translation    {tx:.3f}  {ty:.3f}  {tz:.3f} mm, of the sensor's origin in the {found.frame} frame",
            f"rotation       {W:.4f}  {P:.4f}  {R:.4f}°, R = Rz({R:.4f}) Ry({P:.4f}) Rx({W:.4f})",
            f"one sd         {deviations(s.covariance)} about the sensor's x, y, z, on this robot near these poses",
            f"elsewhere      {deviations(s.covariance_total)}, on a robot accurate to {accuracy} over its workspace",
        ]
    if s:
        rejected = found.labels(rejected=True)
        sizes = [f"noise          {s.noise_mm:.3g} mm, {s.level.how}"]
        sizes += [f"robot errors   {text}" for text in robot_errors(s.level.found)]
        lines += [
            f"residuals      {s.rms_mm:.3g} mm rms, χ²/dof {s.chi2_per_dof:.3g}",
            *([] if found.misread else sizes),
            f"poses          {len(found.labels(rejected=False))} used, {len(rejected)} rejected"
            + (f": {', '.join(rejected)}" if rejected else ""),
        ]
    return "\n".join([*lines, *(f"note           {message}" for message in found.messages)])


def deviations(covariance) -> str:
    """Standard deviations of δ in words."""
    sd = np.sqrt(np.diag(in_mm_deg(covariance)))
    mm, deg = ("  ".join(f"{v:.2g}" for v in part) for part in (sd[:3], sd[3:]))
    return f"{mm} mm along and {deg}°"


def robot_errors(found: ErrorSizes | None) -> list[str]:
    """How large the robot's errors are, one line for each place where they arise."""
    if found is None:
        return []
    lines, sizes = [], {size.name: size for size in found.sizes}
    for place, names in PLACES.items():
        pair = [sizes[name] for name in names if name in sizes]
        if any(size.middle for size in pair):
            said = " and ".join(f"{s.middle:.2g}{unit(s)} ({s.low:.2g} to {s.high:.2g})" for s in pair)
            said += "" if any(size.from_data for size in pair) else ", which these poses hardly show"
        elif any(size.high for size in pair):
            said = "none, or at most " + " and ".join(f"{size.high:.2g}{unit(size)}" for size in pair)
        else:
            said = "none"
        lines += [f"{place}: {said}"] if pair else []
    largest = [np.sqrt(np.linalg.eigvalsh(C[:3, :3])[-1]) for C in (found.covariance, found.exact_robot)]
    if largest[0] > WORTH_A_WORD * largest[1]:
        lines.append(f"in all: the largest standard deviation is {largest[0]:.2g} mm, {largest[1]:.2g} mm without them")
    return lines


def unit(size: Size) -> str:
    """What to put behind a number."""
    return " mm" if size.name.endswith("mm") else "°"
