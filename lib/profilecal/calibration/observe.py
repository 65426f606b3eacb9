"""What a scan shows of its target, as the joint solution takes it."""

from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import shorten

import numpy as np
from numpy import ndarray
from scipy.linalg import block_diag

from profilecal.profiles.ends import FEW
from profilecal.profiles.features import Feature
from profilecal.scan.scan import MEASURED, Scan
from profilecal.scan.tables import ScanError, listed
from profilecal.targets.observations import Observations

LEAST_POSES = 3  # from which a target's place is found
# mm of noise at least: points exactly on a line have no scatter to tell theirs by
LEAST_NOISE_MM = 1e-4


@dataclass(frozen=True)
class Seen:
    """What a scan shows of its target."""

    poses: ndarray  # (k,) indices of those that saw it
    points: ndarray  # (k, m, 2) what they saw, mm
    # of it by the profiles themselves, mm², as `Observations` has it
    covariance: ndarray | None = None
    # why other poses did not see it
    notes: tuple[str, ...] = ()

    @property
    def typical_mm(self) -> float:
        """The standard deviation of a coordinate of most poses' features; 0 where the
        profiles do not tell it.
        """
        variance = self.covariance
        if variance is None:
            return 0.0
        if variance.ndim == 3:  # points that are not on a curve
            variance = np.diagonal(variance, axis1=1, axis2=2)
        return float(np.median(np.sqrt(variance.mean(axis=1))))


def observe(scan: Scan, least: int = 0, others: Sequence[Scan] = ()) -> Seen:
    """The target as a scan's profiles, points, chords or arcs show it.

    `others`: more scans by the same scanner. Raises ScanError where fewer than `least`
    poses saw it.
    """
    if scan.measured == "profiles":
        seen = from_profiles(scan, others)
    else:
        seen = from_table(scan)
    if len(seen.poses) < least:
        title = scan.title or f"the {scan.kind}"
        sentence = (
            f"{title}: {len(seen.poses)} of {len(scan.labels)} poses show the target "
            f"({scan.description}); expected {least} or more"
        )
        why = "; ".join([sentence, *questions_on(scan), *seen.notes])
        raise ScanError(shorten(why, 600))
    return seen


def questions_on(scan: Scan) -> list[str]:
    """What a scan gives cause to ask, which its residuals may not show: whether x and z
    of raw profiles are swapped, where only z runs on along most of them.
    """
    if scan.measured != "profiles":
        return []
    only_z = []
    for values in scan.values[:100]:
        steps = np.diff(values[np.isfinite(values).all(axis=1)], axis=0)
        if len(steps) > 9:
            x, z = (steps >= 0).all(axis=0) | (steps <= 0).all(axis=0)
            only_z.append(z and not x)
    if 2 * sum(only_z) <= len(only_z):
        return []
    return [
        "z, and not x, grows or falls all along most profiles, as x does along the "
        "laser line: are their columns swapped?"
    ]


def from_profiles(scan: Scan, others: Sequence[Scan]) -> Seen:
    """The target as raw profiles show it.

    A few do not tell where the field of view ends: they are looked at beside those of
    other scans of such a target too, and what finds more counts.
    """
    features = scan.target.find(scan.values, *scan.sizes.values())
    if len(features) < FEW:
        about = scan.measured, scan.description
        values = [*scan.values]
        for one in others:
            if one is not scan and (one.measured, one.description) == about:
                values += one.values
        beside = scan.target.find(values, *scan.sizes.values())[: len(features)]
        features = max(
            features, beside, key=lambda each: sum(one.found for one in each)
        )
    found = [feature for feature in features if feature.found]
    m = scan.target.points
    points, covariance = curve_points(found) if m is None else marked_points(found, m)
    return Seen(
        poses=np.flatnonzero([feature.found for feature in features]),
        points=points,
        covariance=covariance,
        notes=left_out(scan.labels, [feature.reason for feature in features]),
    )


def curve_points(features: Sequence[Feature]) -> tuple[ndarray, ndarray]:
    """Points (k, m, 2) of each feature and their variances (k, m), mm², as
    `Observations` has them: independent and as uncertain in every direction.
    """
    most = max((len(feature.points) for feature in features), default=1)
    points = np.full((len(features), most, 2), np.nan)
    variance = np.empty((len(features), most))
    for own_points, own, feature in zip(points, variance, features, strict=True):
        m = len(feature.points)
        own_points[:m] = feature.points
        own[:m] = np.trace(feature.covariance, axis1=1, axis2=2) / 2 + LEAST_NOISE_MM**2
        own[m:] = own[:m].mean()  # `typical_mm` is a mean of all
    return points, variance


def marked_points(features: Sequence[Feature], m: int) -> tuple[ndarray, ndarray]:
    """The m points (k, m, 2) of each feature and their covariances (k, 2m, 2m), mm², as
    `Observations` has them: chords have tips on one line.
    """
    blocks = [block_diag(*feature.covariance) for feature in features]
    covariance = np.reshape(blocks, (-1, 2 * m, 2 * m))
    covariance = covariance + LEAST_NOISE_MM**2 * np.eye(2 * m)
    for whole, feature in zip(covariance, features, strict=True):
        if feature.between is not None:
            whole[:2, 2:], whole[2:, :2] = feature.between, feature.between.T
    return np.reshape([feature.points for feature in features], (-1, m, 2)), covariance


def left_out(labels: Sequence[str], reasons: Sequence[str]) -> tuple[str, ...]:
    """Sentences on the poses that did not see the target, those with a reason."""
    alike: dict[str, list[int]] = {}
    for k, reason in enumerate(reasons):
        if reason:  # in which numbers may differ
            alike.setdefault("".join(filter(str.isalpha, reason)), []).append(k)
    return tuple(
        f"{len(own)} {'poses' if own[1:] else 'pose'} left out, "
        f"{reasons[own[0]]}: {listed(labels[k] for k in own)}"
        for own in alike.values()
    )


def from_table(scan: Scan) -> Seen:
    """The points, chords or arcs that a scan holds."""
    found = [len(row) == 1 and 0 < abs(row).max() < np.inf for row in scan.values]
    poses = np.flatnonzero(found)
    shape = -1, len(MEASURED[scan.measured])
    rows = np.reshape([scan.values[i] for i in poses], shape)
    reasons = ["" if own else f"no {scan.measured[:-1]}" for own in found]
    points = points_of(scan.measured, rows)
    return Seen(poses, points, notes=left_out(scan.labels, reasons))


def points_of(measured: str, values: ndarray) -> ndarray:
    """Points (k, m, 2) that stand for sensed points, chords or arcs, one a row."""
    if measured == "chords":  # the tip of smaller x first
        tips = values.reshape(-1, 2, 2)
        return np.take_along_axis(tips, np.argsort(tips[..., :1], axis=1), axis=1)
    if measured == "arcs":  # by three points a third of a turn apart on each circle
        angle = np.radians([90, 210, 330])
        around = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        return values[:, None, :2] + values[:, None, 2:] * around
    return values[:, None, :]


def as_observations(scan: Scan, seen: Seen, reference_mm: float = 0.0) -> Observations:
    """What the joint calibration takes of one scan, its covariance in units of the
    noise `reference_mm`.
    """
    R, T = scan.base_flange(seen.poses)
    covariance = None
    if seen.covariance is not None and reference_mm:
        covariance = seen.covariance[None] / reference_mm**2
    return Observations(
        kind=scan.kind,
        R_flange=R[None],
        T_flange=T[None],
        points=seen.points[None],
        sizes=tuple(scan.sizes.values()),
        group=scan.group[seen.poses],
        eye_to_hand=scan.mount == "eye-to-hand",
        covariance=covariance,
        are_circles=scan.measured == "arcs",
        log=scan.log,
        times=None if scan.log is None else scan.times[None, seen.poses],
        delay_s=(scan.delay_ms or 0) / 1000,
        delay_known=scan.delay_ms is not None,
    )


def observe_all(
    scans: Sequence[Scan],
) -> tuple[list[Seen], tuple[Observations, ...], float]:
    """What each scan shows, the same for the joint solution, and the unit of its
    covariances: the typical standard deviation of features of profiles, mm (0 where
    there are none).
    """
    seen = [observe(scan, LEAST_POSES, scans) for scan in scans]
    features_mm = next((entry.typical_mm for entry in seen if entry.typical_mm), 0.0)
    observed = [
        as_observations(scan, entry, features_mm)
        for scan, entry in zip(scans, seen, strict=True)
    ]
    return seen, tuple(observed), features_mm
