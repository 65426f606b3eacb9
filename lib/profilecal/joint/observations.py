"""One calibration for every target: the sensor pose and all placements in one maximum-likelihood step.

Unknown are the sensor pose (6) and where each target is (edge 4, disk 5, ball 3, plane 3, point 3). A residual is an
observed point minus where the scan plane meets the target, in the scan plane. Each target file offers `residual` and
its derivatives in the *sensor* frame; everything else is the same for all of them and is written once, here.

The sensor pose is perturbed as T · exp(δ), δ = (ρ, φ) in the sensor's frame: a point at p there moves to
p - ρ + p × φ, a direction d to d + d × φ. Every function takes a batch of problems along the leading axis.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2 as chi2_law

from profilecal.targets import ball, disk, edge, plane, point

TARGETS = {"edge": edge, "disk": disk, "ball": ball, "plane": plane, "point": point}
BATCHED = ("R_flange", "T_flange", "points", "covariance")  # the fields of Observations with a batch axis


@dataclass(frozen=True)
class Observations:
    """What the scanner saw of one target from P flange poses; leading axes are a batch of problems."""

    kind: str  # edge, disk, ball, plane or point
    R_flange: np.ndarray  # (..., P, 3, 3) flange in the base frame; eye-to-hand: base in the flange frame
    T_flange: np.ndarray  # (..., P, 3) mm
    points: np.ndarray  # (..., P, m, 2) x and z; edge, point m = 1, disk m = 2 (tips, by x); NaN: none
    size: float | None = None  # radius of disk and ball, mm
    group: np.ndarray | None = None  # (P,) poses of one flange orientation share a number
    eye_to_hand: bool = False
    # of what was seen from each pose, as a multiple of `Noise.profile_mm`²; None: 1 for each coordinate, independent.
    # edge, disk (..., P, 2m, 2m) of x and z of its points; ball, plane (..., P, m) of their distance from the curve
    covariance: np.ndarray | None = None

    def __post_init__(self):
        if self.kind not in TARGETS:
            raise ValueError(f"kind is {self.kind!r}; expected one of {', '.join(TARGETS)}")
        if self.kind in ("ball", "disk") and not (self.size and self.size > 0):
            raise ValueError(f"the {self.kind}'s radius is {self.size}; expected a length in mm")
        shape, count = np.shape(self.points), {"edge": 1, "point": 1, "disk": 2}.get(self.kind)
        if len(shape) < 3 or shape[-1] != 2 or (count and shape[-2] != count):
            raise ValueError(f"points of the {self.kind} have shape {shape}; expected (..., poses, {count or 'm'}, 2)")
        for name, value, tail in (("R_flange", self.R_flange, (3, 3)), ("T_flange", self.T_flange, (3,))):
            if np.shape(value)[-1 - len(tail) :] != (shape[-3], *tail):
                raise ValueError(f"{name} has shape {np.shape(value)}; expected (..., {shape[-3]}, {tail})")
            if not np.isfinite(value).all():
                raise ValueError(f"{name} holds a value that is not finite; expected a pose for every profile")
        if self.group is not None and np.shape(self.group) != (shape[-3],):
            raise ValueError(f"group has shape {np.shape(self.group)}; expected ({shape[-3]},), one label per pose")
        if self.covariance is not None:
            if self.kind == "point":
                raise ValueError("a marked point has no covariance of its own; state profile_mm and steering_mm")
            P, m = shape[-3:-1]
            tail, given = (P, m) if self.on_curve else (P, 2 * m, 2 * m), np.shape(self.covariance)
            if given[-len(tail) :] != tail:
                raise ValueError(f"covariance has shape {given}; expected (..., {', '.join(map(str, tail))})")

    def keep(self, poses) -> "Observations":
        """Only some poses, by mask or index."""
        group = None if self.group is None else np.asarray(self.group)[poses]
        covariance = self.covariance
        if covariance is not None:
            covariance = covariance[..., poses, :] if self.on_curve else covariance[..., poses, :, :]
        return replace(
            self,
            R_flange=self.R_flange[..., poses, :, :],
            T_flange=self.T_flange[..., poses, :],
            points=self.points[..., poses, :, :],
            group=group,
            covariance=covariance,
        )

    @property
    def on_curve(self) -> bool:
        """Whether points lie anywhere on a curve, so that only their distance from it says something."""
        return self.kind in ("ball", "plane")


def affine_noise(observations: Observations) -> tuple[float, int]:
    """Scanner noise from an edge or a marked point before anything is calibrated, mm, and its degrees of freedom.

    Inside a rotation group the sensed point is an affine function of the flange position, whatever the calibration:
    what is left of a regression is noise. The median over the groups keeps a bad point from counting.
    """
    points, group = np.asarray(observations.points)[0, :, 0], np.asarray(observations.group)
    root_weight = np.ones((len(points), 1))
    if observations.covariance is not None:
        root_weight = 1 / np.sqrt(np.trace(observations.covariance[0], axis1=1, axis2=2) / 2)[:, None]
    variances, freedoms = [], []
    for label in np.unique(group):
        rows = (group == label) & np.isfinite(points).all(axis=1)
        T, w = observations.T_flange[0, rows], root_weight[rows]
        if len(T) < 3:
            continue
        T, y = (w * (v - np.average(v, axis=0, weights=w[:, 0] ** 2)) for v in (T, points[rows]))
        U, s, _ = np.linalg.svd(T, full_matrices=False)
        U = U[:, s > 1e-3 * s.max()]
        freedom = len(T) - 1 - U.shape[1]
        if freedom > 0:
            variances.append(np.sum((y - U @ (U.T @ y)) ** 2) / chi2_law.median(2 * freedom))
            freedoms.append(2 * freedom)
    return (float(np.sqrt(np.median(variances))), sum(freedoms)) if variances else (0.0, 0)


def take(observations: Observations, chosen) -> Observations:
    """Some problems of a batch of observations, by mask, index or slice."""
    given = {name: getattr(observations, name) for name in BATCHED}
    batch = {name: np.asarray(value) for name, value in given.items() if value is not None}
    length = max(map(len, batch.values()))
    return replace(observations, **{k: v[chosen] if len(v) == length else v for k, v in batch.items()})
