"""What a scan holds, before any calibration: lines, each a name and a text."""

from collections import Counter
from collections.abc import Iterable

import numpy as np

from profilecal.calibration.observe import as_observations, observe, questions_on
from profilecal.geometry.checks import UnobservableError
from profilecal.geometry.noise import Noise
from profilecal.geometry.observability import LEAST_TURN_DEG, name_axis, turns
from profilecal.joint.problem import Problem
from profilecal.joint.smooth import shifting
from profilecal.scan.scan import Scan
from profilecal.targets.observations import Observations

# a name and what it is; a line without a name stands for itself
Lines = Iterable[tuple[str, str]]
# of the speed: what one screw in the base and one in the flange leave of twists that
# are no more than those
OPEN = 0.05


def check(scan: Scan) -> Lines:
    """What a scan holds: poses, groups, noise, motions; and notes on what it lacks.
    Raises ScanError where no pose shows the target.
    """
    seen = observe(scan, 1)
    observed = as_observations(scan, seen)
    yield "target", scan.description
    yield (
        "poses",
        f"{len(scan.labels)}, {scan.mount}, orientation as {scan.convention}; "
        f"{len(seen.poses)} show the target",
    )
    yield from on_poses(scan)
    noise = "unknown before the calibration"
    if seen.typical_mm:
        size = f"{seen.typical_mm:.2g} mm of a feature's coordinates"
        noise = f"{size}, by the scatter in profiles"
    yield "noise", noise
    if scan.log:
        yield from on_motion(scan, observed)
    try:
        Problem([observed], Noise(1.0)).check_enough()
    except UnobservableError as error:
        yield "note", str(error)
    for note in (*seen.notes, *questions_on(scan)):
        yield "note", note


def on_poses(scan: Scan) -> Lines:
    """Where the robot was, and how it was turned."""
    reach = np.linalg.norm(scan.p_base_flange, axis=1)
    yield "positions", f"{reach.min():.0f} to {reach.max():.0f} mm from the base"
    sizes = Counter(np.bincount(scan.group).tolist())
    groups = ", ".join(
        f"{count} with {size} pose{'s' * (size > 1)}" for size, count in sizes.items()
    )
    name, of = "orientations", ""
    if scan.log:
        name, of = "groups", " of one orientation or sweep"
    origin = "given" if scan.group_given else "found"
    yield name, f"{scan.group.max() + 1}{of}, {origin}: {groups}"
    (a, b, c), axis = turns(scan.R_base_flange)
    about = f"about three axes, most about {name_axis(axis, 'flange')}"
    yield "turns", f"{a:.1f}, {b:.1f}, {c:.1f}° rms {about}"
    if np.hypot(b, c) < LEAST_TURN_DEG:
        tilt = "add poses tilted by 15° or more about two axes"
        yield "note", f"{tilt}, or something stays unknown"


def on_motion(scan: Scan, observed: Observations) -> Lines:
    """How fast sweeps were, and whether they tell the delay."""
    speed = np.linalg.norm(observed.twist[:, :3], axis=1).max()
    sweeps = len({*scan.group[scan.moving]})
    yield (
        "motion",
        f"{scan.moving.sum()} profiles in {sweeps} sweeps, up to {speed:.0f} mm/s; "
        f"{len(scan.log.t)} rows of the robot's log",
    )
    yield "delay", what_motions_tell(observed)


def what_motions_tell(observed: Observations) -> str:
    """Whether motions determine the delay between two clocks, in words.

    What is left of the flange's twists if they are those of one screw in the base,
    which moves the target, or of one in the flange besides: root mean squares over that
    of all. Where little is left, a delay is hidden.

    The screw (v, ω) of the base is a twist (Rᵀ (v + ω × p), Rᵀ ω) along the flange's
    axes. Turns count as what they move 100 mm away.
    """
    R, p = observed.R_flange[0], observed.T_flange[0]
    in_mm = np.repeat([1.0, 100.0], 3)
    twist = observed.twist
    if observed.eye_to_hand:  # that of the base's origin, from that of the flange's
        twist = np.matvec(shifting(np.matvec(R.mT, p)), twist)
    twists = (twist * in_mm).ravel()
    of_base = np.kron(np.eye(2), R.mT) @ shifting(p)
    of_flange = np.broadcast_to(np.eye(6), of_base.shape)
    left = []
    for screws in (of_base, np.concatenate([of_base, of_flange], axis=2)):
        rows = (screws * in_mm[:, None]).reshape(len(twists), -1)
        off = twists - rows @ np.linalg.lstsq(rows, twists, rcond=1e-9)[0]
        left.append(np.linalg.norm(off) / np.linalg.norm(twists))
    if left[1] > OPEN:
        return "these motions determine it"
    if left[0] < OPEN:
        return "these motions leave it open; it shifts the target, not the sensor"
    return (
        "these motions leave it open, and the sensor's pose with it: the scanner goes "
        "one way; drive the same sweeps backwards, or stop at eight places"
    )
