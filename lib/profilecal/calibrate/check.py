"""What a scan holds, before any calibration."""

from collections import Counter

import numpy as np

from profilecal.calibrate.observe import as_observations, observe
from profilecal.geometry.fitting import affine_residuals
from profilecal.geometry.noise import FALSE_ALARM, chi2_limit
from profilecal.joint.observability import LEAST_TURN_DEG, name_axis, turns
from profilecal.joint.observations import Observations
from profilecal.scan.scan import Scan
from profilecal.scan.tables import listed


def check(scan: Scan) -> list[str]:
    """What a scan holds, in lines for people: convention, groups, noise and outliers known before any calibration."""
    seen = observe(scan)
    poses, P, groups = seen.poses, len(scan.labels), scan.group.max() + 1
    reach = np.linalg.norm(scan.T_base_flange, axis=1)
    angles, axis = turns(scan.R_base_flange)
    lines = [
        f"target         {scan.description}",
        f"poses          {P}, {scan.mount}, orientation as {scan.convention}; {len(poses)} show the target",
        f"positions      {reach.min():.0f} to {reach.max():.0f} mm from the base",
        f"groups         {groups} of one orientation, {'given' if scan.group_given else 'found'}: "
        + ", ".join(f"{count} of {size} poses" for size, count in Counter(np.bincount(scan.group).tolist()).items()),
        f"turns          {angles[0]:.1f}, {angles[1]:.1f}, {angles[2]:.1f}° rms about three axes, "
        f"most about {name_axis(axis, 'flange')}",
    ]
    if np.linalg.norm(angles[1:]) < LEAST_TURN_DEG:
        lines.append("note           add poses tilted by 15° or more about two axes, or something stays unknown")
    if scan.target.affine and len(poses):
        observed = as_observations(scan, seen)
        noise, freedom = affine_noise(observed)
        if freedom:
            lines.append(f"noise          {noise:.3g} mm inside groups, from {freedom} degrees of freedom")
            for rows in affine_outliers(observed):
                named = [scan.labels[i] for i in poses[rows]]
                lines.append(
                    f"note           pose {named[0]} does not fit its group"
                    if len(named) == 1
                    else f"note           one of the poses {listed(named)} does not fit: one more would tell which"
                )
        else:
            lines.append("noise          unknown before the calibration: groups have too few poses (5 or more each)")
    return [*lines, *(f"note           {text}" for text in (*scan.warnings, *seen.remarks))]


def affine_outliers(observations: Observations) -> list[list[int]]:
    """Poses whose points do not fit their group, by the relation that needs no calibration: one each, or several where
    it is one of them.

    Inside a group the sensed points are an affine function of the flange position. The pose that fits worst is taken
    out as long as chance does not explain it. With one degree of freedom left, all fit equally badly. A whole group on
    a wrong edge is not seen.
    """
    noise, bad = affine_noise(observations)[0], []
    points = np.asarray(observations.points)[0].reshape(len(observations.labels), -1)
    limit = chi2_limit(FALSE_ALARM / len(points), points.shape[1])
    for label in np.unique(observations.group):
        rows = np.flatnonzero(observations.group == label)
        while len(rows) > 3:
            left, basis, freedom = affine_residuals(observations.T_flange[0, rows], points[rows])
            free = 1 - np.sum(basis**2, axis=1)
            if freedom <= 0 or free.min() < 1e-6:
                break
            size = np.sum(left**2, axis=1) / free / noise**2
            if size.max() < limit:
                break
            if freedom == 1:
                bad.append(rows.tolist())
                break
            bad.append([int(rows[size.argmax()])])
            rows = np.delete(rows, size.argmax())
    return sorted(bad)


def affine_noise(observations: Observations) -> tuple[float, int]:
    """Scanner noise from an edge or a marked point before anything is calibrated, mm, and its degrees of freedom.

    Inside a rotation group the sensed point is an affine function of the flange position, whatever the calibration:
    what is left of a regression is noise. The median over the groups keeps a bad point from counting.
    """
    P, m = observations.points.shape[-3:-1]
    points, weights = np.asarray(observations.points)[0].reshape(P, 2 * m), np.ones(P)
    if observations.covariance is not None:
        weights = np.sqrt(2 * m / np.trace(observations.covariance[0], axis1=1, axis2=2))
    variances, freedoms = [], []
    for label in np.unique(observations.group):
        rows = (observations.group == label) & np.isfinite(points).all(axis=1)
        if rows.sum() < 3:
            continue
        left, _, freedom = affine_residuals(observations.T_flange[0, rows], points[rows], weights[rows])
        if freedom > 0:
            variances.append(np.sum(left**2) / chi2_limit(0.5, 2 * m * freedom))
            freedoms.append(2 * m * freedom)
    return (float(np.sqrt(np.median(variances))), sum(freedoms)) if variances else (0.0, 0)
