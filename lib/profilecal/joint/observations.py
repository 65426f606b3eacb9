"""What the scanner saw of a target, arranged for the joint solution."""

from dataclasses import dataclass, replace

import numpy as np

from profilecal.targets import TARGETS
from profilecal.targets.target import Target

BATCHED = ("R_flange", "T_flange", "points", "covariance")  # the fields of Observations with a batch axis


@dataclass(frozen=True)
class Observations:
    """What the scanner saw of one target from P flange poses; leading axes are a batch of problems."""

    kind: str  # of the target, one of TARGETS
    R_flange: np.ndarray  # (..., P, 3, 3) flange in the base frame; eye-to-hand: base in the flange frame
    T_flange: np.ndarray  # (..., P, 3) mm
    points: np.ndarray  # (..., P, m, 2) x and z, m as the target's `points`; NaN: none
    sizes: tuple[float, ...] = ()  # the target's `lengths`, mm
    group: np.ndarray | None = None  # (P,) poses of one flange orientation share a number
    eye_to_hand: bool = False
    # of what was seen from each pose, as a multiple of `Noise.profile_mm`²; None: 1 for each coordinate, independent.
    # (..., P, m) of points' distances from a curve; else (..., P, 2m, 2m) of x and z of all points
    covariance: np.ndarray | None = None

    def __post_init__(self):
        if self.kind not in TARGETS:
            raise ValueError(f"kind is {self.kind!r}; expected one of {', '.join(TARGETS)}")
        self.target.check_sizes(self.sizes)
        shape, count = np.shape(self.points), self.target.points
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
            if "profiles" not in self.target.tables:
                raise ValueError(f"a {self.kind} has no covariance of its own; state profile_mm and steering_mm")
            P, m = shape[-3:-1]
            tail, given = (P, m) if self.on_curve else (P, 2 * m, 2 * m), np.shape(self.covariance)
            if given[-len(tail) :] != tail:
                raise ValueError(f"covariance has shape {given}; expected (..., {', '.join(map(str, tail))})")

    @property
    def target(self) -> type[Target]:
        """The class of the target."""
        return TARGETS[self.kind]

    @property
    def on_curve(self) -> bool:
        """Whether points lie anywhere on a curve, so that only their distance from it says something."""
        return self.target.points is None

    @property
    def labels(self) -> np.ndarray:
        """Numbers from 0 (P,) that the poses of one rotation group share; without groups, each its own."""
        poses = np.arange(np.shape(self.points)[-3])
        return poses if self.group is None else np.unique(self.group, return_inverse=True)[1]

    def keep(self, poses) -> "Observations":
        """Only some poses, by mask or index."""
        covariance = self.covariance
        if covariance is not None:
            covariance = covariance[..., poses, :] if self.on_curve else covariance[..., poses, :, :]
        return replace(
            self,
            R_flange=self.R_flange[..., poses, :, :],
            T_flange=self.T_flange[..., poses, :],
            points=self.points[..., poses, :, :],
            group=None if self.group is None else np.asarray(self.group)[poses],
            covariance=covariance,
        )

    def take(self, chosen) -> "Observations":
        """Some problems of a batch, by mask, index or slice."""
        given = {name: getattr(self, name) for name in BATCHED}
        batch = {name: np.asarray(value) for name, value in given.items() if value is not None}
        length = max(map(len, batch.values()))
        return replace(self, **{k: v[chosen] if len(v) == length else v for k, v in batch.items()})
