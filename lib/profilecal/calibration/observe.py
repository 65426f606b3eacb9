"""What a scan shows of its target, as the joint solution takes it; and in words, before
any calibration.
"""

from collections import Counter
from dataclasses import dataclass, replace
from textwrap import shorten

import numpy as np

from profilecal.geometry.fitting import affine_residuals
from profilecal.geometry.noise import FALSE_ALARM, chi2_limit
from profilecal.geometry.observability import LEAST_TURN_DEG, name_axis, turns
from profilecal.scan.scan import Scan, ScanError
from profilecal.scan.tables import listed
from profilecal.targets.observations import Observations
from profilecal.targets.target import find_features


@dataclass(frozen=True)
class Seen:
    """What a scan shows of its target."""

    poses: np.ndarray  # (k,) indices of those that saw it
    points: np.ndarray  # (k, m, 2) what they saw, mm
    # of it by the profiles themselves, mm², as `Observations` has it
    covariance: np.ndarray | None = None
    shared_mm: float = 0.0  # the part of its error that poses of one orientation share
    # why the other poses did not see it, and what else there is to say
    remarks: tuple[str, ...] = ()

    @property
    def typical_mm(self) -> float:
        """The standard deviation of a coordinate of most poses' features; 0 where the
        profiles do not tell it.
        """
        if self.covariance is None:
            return 0.0
        on_curve = self.covariance.shape == self.points.shape[:2]
        variance = (
            self.covariance
            if on_curve
            else np.diagonal(self.covariance, axis1=1, axis2=2)
        )
        return float(np.median(np.sqrt(variance.mean(axis=1))))


def names(scans) -> list[str]:
    """What to put before a word on one of several scans: its title."""
    titles = [scan.title or scan.kind for scan in scans]
    if len({*titles}) < len(titles):
        titles = [f"{title} ({k})" for k, title in enumerate(titles, 1)]
    return [f"{title}: " if len(scans) > 1 else "" for title in titles]


def observe(scan: Scan, least: int = 0) -> Seen:
    """The target as a scan's profiles, points, chords or arcs show it. Raises ScanError
    where fewer than `least` poses saw it.
    """
    seen = from_profiles(scan) if scan.measured == "profiles" else from_table(scan)
    if len(seen.poses) < least:
        why = "; ".join(remark.rsplit(": ", 1)[0] for remark in seen.remarks)
        raise ScanError(
            f"{scan.title or f'the {scan.kind}'}: the target was found from {len(seen.poses)} poses; "
            f"expected {least} or more" + (f" ({shorten(why, 300)})" if why else "")
        )
    return seen


def from_profiles(scan: Scan) -> Seen:
    """The target as raw profiles show it."""
    features = find_features(scan.target, scan.values, scan.sizes)
    reasons = {}
    for label, feature in zip(scan.labels, features, strict=True):
        if feature.reason:
            alike = "".join(filter(str.isalpha, feature.reason))  # numbers may differ
            reasons.setdefault(alike, [feature.reason]).append(label)
    remarks = [
        f"{len(labels)} left out, {reason}: {', '.join(labels)}"
        for reason, *labels in reasons.values()
    ]
    poses = np.flatnonzero([feature.found for feature in features])
    found = [feature for feature in features if feature.found]
    most = max((len(feature.points) for feature in found), default=1)
    points = np.full((len(poses), most, 2), np.nan)
    for row, feature in zip(points, found, strict=True):
        row[: len(feature.points)] = feature.points
    seen = Seen(
        poses,
        points,
        covariances(found, most, on_curve=scan.target.points is None),
        remarks=tuple(remarks),
    )
    if not any(feature.shape == "tip" for feature in found):
        return seen
    remarks.append(
        "edge points are tips of a blade, which the scanner sees beside the edge by an amount that depends on the "
        f"orientation: {seen.typical_mm:.2g} mm for each are counted in; corners and ends of flat faces are better"
    )
    return replace(seen, shared_mm=seen.typical_mm, remarks=tuple(remarks))


def from_table(scan: Scan) -> Seen:
    """The points, chords or arcs that a scan holds."""
    rows = [values[np.isfinite(values).all(axis=1)] for values in scan.values]
    poses = np.flatnonzero([len(r) > 0 for r in rows])
    missed = [label for label, r in zip(scan.labels, rows, strict=True) if not len(r)]
    remarks = (
        (f"no {scan.measured[:-1]} from pose {', '.join(missed)}",) if missed else ()
    )
    values = (
        np.concatenate([rows[i][:1] for i in poses]) if len(poses) else np.empty((0, 4))
    )
    if scan.measured == "chords":
        tips = values.reshape(-1, 2, 2)
        points = np.take_along_axis(tips, np.argsort(tips[..., :1], axis=1), axis=1)
    elif scan.measured == "arcs":
        points = three_points(values)
    else:
        points = values[:, None, :]
    return Seen(poses, points, remarks=remarks)


def covariances(found, most: int, on_curve: bool) -> np.ndarray:
    """Of `most` points of each feature, mm², as `Observations` has them: those on a
    curve are independent and as uncertain in every direction, chords have tips on one
    line.
    """
    finest = 1e-4  # mm: points exactly on a line have no scatter to tell their noise by
    if on_curve:
        variance = np.ones((len(found), most))
        for row, feature in zip(variance, found, strict=True):
            row[: len(feature.points)] = (
                np.trace(feature.covariance, axis1=1, axis2=2) / 2 + finest**2
            )
        return variance
    covariance = np.zeros((len(found), most, 2, most, 2))
    for pairs, feature in zip(covariance, found, strict=True):
        for k in range(most):
            pairs[k, :, k] = feature.covariance[k] + finest**2 * np.eye(2)
        if feature.between is not None:
            pairs[0, :, 1], pairs[1, :, 0] = feature.between, feature.between.T
    return covariance.reshape(len(found), 2 * most, 2 * most)


def three_points(circles) -> np.ndarray:
    """Three points (n, 3, 2) a third of a turn apart on circles (n, 3) x, z, r: they
    stand for centre and radius.
    """
    angle = np.radians([90, 210, 330])
    around = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return circles[:, None, :2] + circles[:, None, 2:] * around


def as_observations(scan: Scan, seen: Seen, reference_mm: float = 0.0) -> Observations:
    """What the joint calibration takes of one scan, its covariance in units of the
    noise `reference_mm`.
    """
    R, T = scan.base_flange(seen.poses)
    return Observations(
        kind=scan.kind,
        R_flange=R[None],
        T_flange=T[None],
        points=seen.points[None],
        sizes=scan.sizes,
        group=scan.group[seen.poses] if scan.group is not None else None,
        eye_to_hand=scan.mount == "eye-to-hand",
        covariance=None
        if seen.covariance is None or not reference_mm
        else seen.covariance[None] / reference_mm**2,
    )


def observe_all(scans) -> tuple[list[Seen], tuple[Observations, ...], float]:
    """What each scan shows, the same for the joint solution, and the unit of its
    covariances: the typical standard deviation of features of profiles, mm (0 where
    there are none).
    """
    seen = [observe(scan, 3) for scan in scans]
    features_mm = next((entry.typical_mm for entry in seen if entry.typical_mm), 0.0)
    observed = [
        as_observations(scan, entry, features_mm)
        for scan, entry in zip(scans, seen, strict=True)
    ]
    return seen, tuple(observed), features_mm


def stated_noise(scans) -> dict[str, float]:
    """The noise that scans of one scanner and robot state, without that of a profile's
    points where features were fitted to them: their noise is left to be estimated.
    Raises ScanError where the scans contradict each other.
    """
    stated = {}
    for scan in scans:
        for name, value in scan.noise.items():
            if stated.setdefault(name, value) != value:
                raise ScanError(
                    f"noise {name} is {stated[name]:g} in one scan and {value:g} in another; expected one"
                )
    if any(scan.measured in ("arcs", "profiles") for scan in scans):
        stated.pop("profile_mm", None)
    return stated


def check(scan: Scan) -> list[str]:
    """What a scan holds, in lines for people: convention, groups, noise and outliers."""
    seen = observe(scan)
    poses, P, groups = seen.poses, len(scan.labels), scan.group.max() + 1
    reach = np.linalg.norm(scan.p_base_flange, axis=1)
    angles, axis = turns(scan.R_base_flange)
    lines = [
        f"target         {scan.description}",
        f"poses          {P}, {scan.mount}, orientation as {scan.convention}; {len(poses)} show the target",
        f"positions      {reach.min():.0f} to {reach.max():.0f} mm from the base",
        f"groups         {groups} of one orientation, {'given' if scan.group_given else 'found'}: "
        + ", ".join(
            f"{count} of {size} poses"
            for size, count in Counter(np.bincount(scan.group).tolist()).items()
        ),
        f"turns          {angles[0]:.1f}, {angles[1]:.1f}, {angles[2]:.1f}° rms about three axes, "
        f"most about {name_axis(axis, 'flange')}",
    ]
    if np.linalg.norm(angles[1:]) < LEAST_TURN_DEG:
        lines.append(
            "note           add poses tilted by 15° or more about two axes, or something stays unknown"
        )
    affine, freedom = scan.target.affine, 0
    if affine and len(poses):
        observed = as_observations(scan, seen)
        noise, freedom = affine_noise(observed)
        if freedom:
            lines.append(
                f"noise          {noise:.3g} mm inside groups, from {freedom} degrees of freedom"
            )
            for rows in affine_outliers(observed):
                named = [scan.labels[i] for i in poses[rows]]
                misfit = f"one of the poses {listed(named)} does not fit: one more would tell which"
                misfit = (
                    misfit
                    if len(named) > 1
                    else f"pose {named[0]} does not fit its group"
                )
                lines.append(f"note           {misfit}")
    if not freedom and len(poses) and seen.typical_mm:
        lines.append(
            f"noise          {seen.typical_mm:.2g} mm of a feature's coordinates, by the scatter in profiles"
        )
    elif not freedom:
        why = (
            "groups have too few poses (5 or more each)"
            if affine
            else f"what a {scan.kind} shows does not tell it"
        )
        lines.append(f"noise          unknown before the calibration: {why}")
    return [*lines, *(f"note           {text}" for text in seen.remarks)]


def affine_outliers(observations: Observations) -> list[list[int]]:
    """Poses whose points do not fit their group as in `affine_noise`: the one that fits
    worst is taken out as long as chance does not explain it; with one degree of freedom
    left all fit equally badly, so each is named. A whole group on a wrong edge is not
    seen.
    """
    noise, bad = affine_noise(observations)[0], []
    points = np.asarray(observations.points)[0].reshape(len(observations.labels), -1)
    limit = chi2_limit(FALSE_ALARM / len(points), points.shape[1])
    for label in np.unique(observations.group):
        rows = np.flatnonzero(observations.group == label)
        while len(rows) > 3:
            left, basis, freedom = affine_residuals(
                observations.T_flange[0, rows], points[rows]
            )
            free = 1 - np.sum(basis**2, axis=1)
            if free.min() < 1e-6:  # nothing is left over to judge a pose by
                break
            size = np.sum(left**2, axis=1) / free / noise**2
            if size.max() < limit:
                break
            worst = slice(None) if freedom == 1 else [size.argmax()]
            bad.append(rows[worst].tolist())
            rows = np.delete(rows, worst)
    return sorted(bad)


def affine_noise(observations: Observations) -> tuple[float, int]:
    """Scanner noise from an edge or a marked point before anything is calibrated, mm,
    and its degrees of freedom: what `affine_residuals` finds in each group. The median
    over the groups keeps a bad point from counting.
    """
    points, found = (
        np.asarray(observations.points)[0].reshape(len(observations.labels), -1),
        [],
    )
    for label in np.unique(observations.group):
        rows = observations.group == label
        left, _, freedom = affine_residuals(
            observations.T_flange[0, rows], points[rows]
        )
        if freedom > 0:
            freedom = points.shape[1] * freedom
            found.append((np.sum(left**2) / chi2_limit(0.5, freedom), freedom))
    variances, freedoms = zip(*found, strict=True) if found else ((0.0,), (0,))
    return float(np.sqrt(np.median(variances))), int(sum(freedoms))
