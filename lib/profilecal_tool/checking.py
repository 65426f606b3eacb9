"""What a scan holds, in words, before any calibration: `profilecal check`."""

from collections import Counter

import numpy as np

from profilecal.calibration.observe import (
    Seen,
    as_observations,
    doubts,
    observe,
)
from profilecal.geometry.checks import UnobservableError
from profilecal.geometry.fitting import affine_residuals
from profilecal.geometry.noise import FALSE_ALARM, Noise, chi2_limit
from profilecal.geometry.observability import LEAST_TURN_DEG, name_axis, turns
from profilecal.joint.delay import unexplained
from profilecal.joint.problem import Problem
from profilecal.joint.solve import check_enough
from profilecal.scan.scan import Scan
from profilecal.scan.tables import listed
from profilecal.targets.observations import Observations

# of the speed: what one screw in the base and one in the flange leave of twists that
# are no more than those
OPEN = 0.05


def check(scan: Scan) -> list[str]:
    """What a scan holds, before any calibration, in lines for people: convention,
    groups, noise, outliers. Raises ScanError where no pose shows the target.
    """
    seen = observe(scan, 1)
    observed = as_observations(scan, seen)
    lines = [*lines_on_poses(scan, len(seen.poses)), *lines_on_noise(scan, seen)]
    if scan.log:
        lines += lines_on_motion(scan, observed)
    remarks = [*seen.remarks, *doubts(scan)]
    try:
        check_enough(Problem([observed], Noise(1.0)))
    except UnobservableError as error:
        remarks.insert(0, str(error))
    return [*lines, *(f"note           {remark}" for remark in remarks)]


def lines_on_motion(scan: Scan, observed: Observations) -> list[str]:
    """What there is to say of sweeps, and whether they tell the delay."""
    speed = np.linalg.norm(observed.twist[observed.moving[0], :3], axis=1)
    count = len({*scan.group[scan.moving]})
    rows = len(scan.log.t) if scan.log else 0
    return [
        f"motion         {scan.moving.sum()} profiles in {count} sweeps, up to "
        f"{speed.max():.0f} mm/s; {rows} rows of the robot's log",
        f"delay          {what_motions_tell(observed)}",
    ]


def what_motions_tell(observed: Observations) -> str:
    """Whether motions determine the delay between two clocks, in words."""
    left = unexplained(observed)
    if left["both"] > OPEN:
        return "these motions determine it"
    if left["target"] < OPEN:
        return "these motions leave it open; it shifts the target, not the sensor"
    return (
        "these motions leave it open, and the sensor's pose with it: the scanner goes "
        "one way; drive the same sweeps backwards, or stop at three places"
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


def lines_on_noise(scan: Scan, seen: Seen) -> list[str]:
    """What the measurements say of the scanner's noise by themselves, and which of them
    do not fit their group.
    """
    affine = scan.target.affine and not scan.log
    if affine:
        observed = as_observations(scan, seen)
        noise, freedom = affine_noise(observed)
        if freedom:
            labels = np.array(scan.labels)[seen.poses]
            inside = f"{noise:.3g} mm inside groups, from {freedom} degrees of freedom"
            misfits = [misfit(labels[rows]) for rows in affine_outliers(observed)]
            return [f"noise          {inside}", *misfits]
    if seen.typical_mm:
        scatter = f"{seen.typical_mm:.2g} mm of a feature's coordinates"
        return [f"noise          {scatter}, by the scatter in profiles"]
    why = f"what a {scan.kind} shows does not tell it"
    if affine:
        why = "groups have too few poses (5 or more each)"
    if scan.log:
        why = "poses follow the delay"
    return [f"noise          unknown before the calibration: {why}"]


def misfit(labels: np.ndarray) -> str:
    """That one of these poses does not fit its group."""
    if len(labels) == 1:
        return f"note           pose {labels[0]} does not fit its group"
    return (
        f"note           one of the poses {listed(labels)} does not fit: "
        "one more would tell which"
    )


def groups_of(observations: Observations) -> list[np.ndarray]:
    """The poses of each rotation group, as indices."""
    labels = observations.labels
    return [np.flatnonzero(labels == label) for label in np.unique(labels)]


def affine_noise(observations: Observations) -> tuple[float, int]:
    """Scanner noise from an edge or a marked point before anything is calibrated, mm,
    and its degrees of freedom: what `affine_residuals` finds in each group. The median
    over the groups keeps a bad point from counting.
    """
    positions, points = observations.T_flange[0], observations.points[0, :, 0]
    variances, total = [], 0
    for rows in groups_of(observations):
        left, _, freedom = affine_residuals(positions[rows], points[rows])
        if freedom > 0:
            freedom = 2 * int(freedom)
            variances.append(np.sum(left**2) / chi2_limit(0.5, freedom))
            total += freedom
    return (float(np.sqrt(np.median(variances))) if variances else 0.0), total


def affine_outliers(observations: Observations) -> list[list[int]]:
    """Poses whose points do not fit their group as in `affine_noise`: the one that fits
    worst is taken out as long as chance does not explain it; with one degree of freedom
    left all fit equally badly, so each is named. A whole group on a wrong edge is not
    seen.
    """
    noise, _ = affine_noise(observations)
    positions, points = observations.T_flange[0], observations.points[0, :, 0]
    limit = chi2_limit(FALSE_ALARM / len(points), 2)
    outliers = []
    for rows in groups_of(observations):
        while len(rows) > 3:
            left, basis, freedom = affine_residuals(positions[rows], points[rows])
            free = 1 - np.sum(basis**2, axis=1)
            if free.min() < 1e-6:  # nothing is left over to judge a pose by
                break
            size = np.sum(left**2, axis=1) / free / noise**2
            if size.max() < limit:
                break
            worst = slice(None) if freedom == 1 else [size.argmax()]
            outliers.append(rows[worst].tolist())
            rows = np.delete(rows, worst)
    return sorted(outliers)
