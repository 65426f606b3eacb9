"""From a user's scans to a sensor pose with its evidence: observations, joint solution, and what to tell the user."""

from dataclasses import dataclass
from textwrap import shorten

import numpy as np

from profilecal.joint.observations import Observations
from profilecal.profiles.features import find_features
from profilecal.scan.scan import Scan, ScanError

FROM_PROFILES = "from the profiles themselves"


LEAST_POSES = 3


FINEST_MM = 1e-4  # of features: points exactly on a line have no scatter to tell their noise by


@dataclass(frozen=True)
class Seen:
    """What a scan shows of its target."""

    poses: np.ndarray  # (k,) indices of those that saw it
    points: np.ndarray  # (k, m, 2) what they saw, mm
    covariance: np.ndarray | None = None  # of it by the profiles themselves, mm², as `Observations` has it
    shared_mm: float = 0.0  # the part of its error that poses of one orientation share
    remarks: tuple[str, ...] = ()  # why the other poses did not see it, and what else there is to say

    @property
    def measured(self) -> bool:
        """Whether the profiles tell the noise."""
        return self.covariance is not None


def names(scans) -> list[str]:
    """What to put before a word on one of several scans: its title."""
    return [f"{scan.title or scan.kind}: " if len(scans) > 1 else "" for scan in scans]


def target_seen(scan: Scan) -> Seen:
    """`observations` of a scan. Raises ScanError where there are too few."""
    seen = observations(scan)
    if len(seen.poses) < LEAST_POSES:
        name = scan.title or f"the {scan.kind}"
        why = "; ".join(remark.rsplit(": ", 1)[0] for remark in seen.remarks)
        raise ScanError(
            f"{name}: the target was found from {len(seen.poses)} poses; expected {LEAST_POSES} or more"
            + (f" ({shorten(why, 300)})" if why else "")
        )
    return seen


def observations(scan: Scan) -> Seen:
    """The target as a scan's profiles show it, or as the points, chords or arcs that it holds."""
    if scan.measured == "profiles":
        found = find_features(scan.kind, scan.values, scan.radius)
        reasons = {}
        for label, feature in zip(scan.labels, found, strict=True):
            if feature.reason:
                reasons.setdefault(feature.reason, []).append(label)
        why = [f"{len(labels)} left out, {reason}: {', '.join(labels)}" for reason, labels in reasons.items()]
        poses = np.flatnonzero([not f.reason for f in found])
        most = max((len(found[i].points) for i in poses), default=1)
        points = np.full((len(poses), most, 2), np.nan)
        for row, i in enumerate(poses):
            points[row, : len(found[i].points)] = found[i].points
        covariance, shared = covariances(scan.kind, [found[i] for i in poses], most), 0.0
        if any(f.shape == "tip" for f in found):
            shared = typical(scan.kind, covariance)
            why.append(
                "edge points are tips of a blade, which the scanner sees beside the edge by an amount that depends on "
                f"the orientation: {shared:.2g} mm for each are counted in; corners and ends of flat faces are better"
            )
        return Seen(poses, points, covariance, shared, tuple(why))

    rows = [values[np.isfinite(values).all(axis=1)] for values in scan.values]
    poses = np.flatnonzero([len(r) > 0 for r in rows])
    missed = [label for label, r in zip(scan.labels, rows, strict=True) if not len(r)]
    why = (f"no {scan.measured[:-1]} from pose {', '.join(missed)}",) if missed else ()
    values = np.concatenate([rows[i][:1] for i in poses]) if len(poses) else np.empty((0, 4))
    if scan.measured == "chords":
        tips = values.reshape(-1, 2, 2)
        points = np.take_along_axis(tips, np.argsort(tips[..., :1], axis=1), axis=1)
    elif scan.measured == "arcs":
        points = circle_points(values)
    else:
        points = values[:, None, :]
    return Seen(poses, points, remarks=why)


def covariances(kind: str, found, most: int) -> np.ndarray:
    """Of `most` points of each feature, mm², as `Observations` has them: arcs' and lines' are independent and as
    uncertain in every direction, chords have tips on one line."""
    if kind in ("ball", "plane"):
        variance = np.ones((len(found), most))
        for row, feature in zip(variance, found, strict=True):
            row[: len(feature.points)] = np.trace(feature.covariance, axis1=1, axis2=2) / 2 + FINEST_MM**2
        return variance
    covariance = np.zeros((len(found), most, 2, most, 2))
    for pairs, feature in zip(covariance, found, strict=True):
        for k in range(most):
            pairs[k, :, k] = feature.covariance[k] + FINEST_MM**2 * np.eye(2)
        if feature.between is not None:
            pairs[0, :, 1], pairs[1, :, 0] = feature.between, feature.between.T
    return covariance.reshape(len(found), 2 * most, 2 * most)


def typical(kind: str, covariance) -> float:
    """The standard deviation of a coordinate of most poses' features, mm."""
    variance = covariance if kind in ("ball", "plane") else np.diagonal(covariance, axis1=1, axis2=2)
    return float(np.median(np.sqrt(variance.mean(axis=1))))


def circle_points(circles) -> np.ndarray:
    """Three points (n, 3, 2) a third of a turn apart on circles (n, 3) x, z, r: they stand for centre and radius."""
    angle = np.radians([90, 210, 330])
    around = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return circles[:, None, :2] + circles[:, None, 2:] * around


def as_observations(scan: Scan, seen: Seen, reference: float = 0.0) -> Observations:
    """What the joint calibration takes of one scan, its covariance in units of the noise `reference`, mm."""
    R, T = scan.R_base_flange[seen.poses], scan.T_base_flange[seen.poses]
    if scan.mount == "eye-to-hand":
        R = R.transpose(0, 2, 1)
        T = -np.einsum("nab,nb->na", R, T)
    group = scan.group[seen.poses] if scan.group is not None else None
    covariance = seen.covariance[None] / reference**2 if seen.measured and reference else None
    to_hand = scan.mount == "eye-to-hand"
    return Observations(scan.kind, R[None], T[None], seen.points[None], scan.radius, group, to_hand, covariance)
