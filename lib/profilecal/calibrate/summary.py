"""What `profilecal calibrate` prints for people."""

import numpy as np

from profilecal.calibrate.calibration import Calibration
from profilecal.geometry.poses import xyz_angles_from_rotation
from profilecal.joint.error_sizes import ErrorSizes
from profilecal.joint.solution import in_mm_deg

PLACES = {
    "at each visit": ("repeatability_mm", "repeatability_deg"),
    "at each pose": ("position_mm", "orientation_deg"),
    "shared by the poses of an orientation": ("group_position_mm", "group_orientation_deg"),
}


def to_text(found: Calibration, to_paste: str = "") -> str:
    """What `profilecal calibrate` prints for people. `to_paste`: the pose as a controller takes it."""
    s, lines = found.solution, [f"status         {found.status}"]
    if found.status != "unobservable":
        W, P, R = np.degrees(xyz_angles_from_rotation(s.rotation))
        W = (W + 180) % 360 - 180
        tx, ty, tz = s.translation
        lines += [
            f"translation    {tx:.3f}  {ty:.3f}  {tz:.3f} mm, of the sensor's origin in the {found.frame} frame",
            f"rotation       {W:.4f}  {P:.4f}  {R:.4f}°, R = Rz({R:.4f}) Ry({P:.4f}) Rx({W:.4f})",
            *filter(None, [to_paste]),
            f"uncertainty    {deviations(s.covariance)} about the sensor's x, y, z: one standard deviation near these "
            "poses, from noise, robot errors, tolerances",
        ]
    if s:
        rejected = found.labels(rejected=True)
        lines.append(
            f"poses          {len(found.labels(rejected=False))} used, {len(rejected)} rejected"
            + (f": {', '.join(rejected)}" if rejected else "")
        )
    lines += [f"note           {message}" for message in found.messages]
    if s and not found.misread:
        lines.append(f"robot errors   {robot_errors(s.found)}")
        if s.noise_source == "given":  # an estimate makes it 1
            lines.append(f"residuals      {s.rms_mm:.3g} mm rms, χ²/dof {s.chi2_per_dof:.3g}")
    return "\n".join(lines)


def deviations(covariance) -> str:
    """Standard deviations of δ in words."""
    sd = np.sqrt(np.diag(in_mm_deg(covariance)))
    mm, deg = ("  ".join(f"{v:.2g}" for v in part) for part in (sd[:3], sd[3:]))
    return f"{mm} mm along and {deg}°"


def robot_errors(found: ErrorSizes) -> str:
    """How large the robot's errors are, at each place where they arise."""
    said, sizes = [], {size.name: size.middle for size in found.sizes}
    for place, (mm, deg) in PLACES.items():
        if sizes.get(mm) or sizes.get(deg):
            said.append(f"{place} {sizes.get(mm, 0):.2g} mm and {sizes.get(deg, 0):.2g}°")
    return ", ".join(said) or "none that the residuals show"
