"""What a scan holds, in words, before any calibration: `profilecal check`."""

from collections import Counter

import numpy as np

from profilecal.calibration.doubts import doubts
from profilecal.calibration.observe import as_observations, observe
from profilecal.geometry.checks import UnobservableError
from profilecal.geometry.noise import Noise
from profilecal.geometry.observability import LEAST_TURN_DEG, name_axis, turns
from profilecal.joint.problem import Problem
from profilecal.joint.smooth import shifting
from profilecal.scan.scan import Scan
from profilecal.targets.observations import Observations

# of the speed: what one screw in the base and one in the flange leave of twists that
# are no more than those
OPEN = 0.05


def check(scan: Scan) -> list[str]:
    """What a scan holds, before any calibration, in lines for people: convention,
    groups, noise. Raises ScanError where no pose shows the target.
    """
    seen = observe(scan, 1)
    observed = as_observations(scan, seen)
    lines = lines_on_poses(scan, len(seen.poses))
    noise = "unknown before the calibration"
    if seen.typical_mm:
        noise = (
            f"{seen.typical_mm:.2g} mm of a feature's coordinates, "
            "by the scatter in profiles"
        )
    lines.append(f"noise          {noise}")
    if scan.log:
        lines += lines_on_motion(scan, observed)
    remarks = [*seen.remarks, *doubts(scan)]
    try:
        Problem([observed], Noise(1.0)).check_enough()
    except UnobservableError as error:
        remarks.insert(0, str(error))
    return [*lines, *(f"note           {remark}" for remark in remarks)]


def lines_on_motion(scan: Scan, observed: Observations) -> list[str]:
    """What there is to say of sweeps, and whether they tell the delay."""
    speed = np.linalg.norm(observed.twist[observed.moving[0], :3], axis=1)
    count = len({*scan.group[scan.moving]})
    return [
        f"motion         {scan.moving.sum()} profiles in {count} sweeps, up to "
        f"{speed.max():.0f} mm/s; {len(scan.log.t)} rows of the robot's log",
        f"delay          {what_motions_tell(observed)}",
    ]


def what_motions_tell(observed: Observations) -> str:
    """Whether motions determine the delay between two clocks, in words.

    What is left of the flange's twists if they are those of one screw in the base,
    which moves the target, or of one in the flange besides: root mean squares over that
    of all. Where little is left, a delay is hidden.

    The screw (v, ω) of the base is a twist (Rᵀ (v + ω × p), Rᵀ ω) along the flange's
    axes. Turns count as what they move 100 mm away.
    """
    R, p = observed.R_flange[0], observed.T_flange[0]
    of_base = np.kron(np.eye(2), R.mT) @ shifting(p)
    of_flange = np.broadcast_to(np.eye(6), of_base.shape)
    in_mm = np.repeat([1.0, 100.0], 3)
    twists = (observed.twist * in_mm).ravel()
    left = []
    for columns in (of_base, np.concatenate([of_base, of_flange], axis=2)):
        rows = (columns * in_mm[:, None]).reshape(len(twists), -1)
        screws = np.linalg.lstsq(rows, twists, rcond=1e-9)[0]
        left.append(np.linalg.norm(twists - rows @ screws) / np.linalg.norm(twists))
    if left[1] > OPEN:
        return "these motions determine it"
    if left[0] < OPEN:
        return "these motions leave it open; it shifts the target, not the sensor"
    return (
        "these motions leave it open, and the sensor's pose with it: the scanner goes "
        "one way; drive the same sweeps backwards, or stop at eight places"
    )


def lines_on_poses(scan: Scan, showing: int) -> list[str]:
    """What there is to say of the poses, of which some show the target."""
    reach = np.linalg.norm(scan.p_base_flange, axis=1)
    angles, axis = turns(scan.R_base_flange)
    sizes = Counter(np.bincount(scan.group).tolist())
    groups = ", ".join(
        f"{count} with {size} pose{'s' * (size > 1)}" for size, count in sizes.items()
    )
    label = "groups" if scan.log else "orientations"
    alike = " of one orientation or sweep" if scan.log else ""
    origin = "given" if scan.group_given else "found"
    lines = [
        f"target         {scan.description}",
        f"poses          {len(scan.labels)}, {scan.mount}, orientation as "
        f"{scan.convention}; {showing} show the target",
        f"positions      {reach.min():.0f} to {reach.max():.0f} mm from the base",
        f"{label:<15}{scan.group.max() + 1}{alike}, {origin}: {groups}",
        f"turns          {angles[0]:.1f}, {angles[1]:.1f}, {angles[2]:.1f}° rms about "
        f"three axes, most about {name_axis(axis, 'flange')}",
    ]
    if np.linalg.norm(angles[1:]) < LEAST_TURN_DEG:
        lines.append(
            "note           add poses tilted by 15° or more about two axes, "
            "or something stays unknown"
        )
    return lines
