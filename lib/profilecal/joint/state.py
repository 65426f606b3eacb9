"""One calibration for every target: the sensor pose and all placements in one maximum-likelihood step.

Unknown are the sensor pose (6) and where each target is (edge 4, disk 5, ball 3, plane 3, point 3). A residual is an
observed point minus where the scan plane meets the target, in the scan plane. Each target file offers `residual` and
its derivatives in the *sensor* frame; everything else is the same for all of them and is written once, here.

The sensor pose is perturbed as T · exp(δ), δ = (ρ, φ) in the sensor's frame: a point at p there moves to
p - ρ + p × φ, a direction d to d + d × φ. Every function takes a batch of problems along the leading axis.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation


@dataclass(frozen=True)
class State:
    """Sensor pose (B, 3, 3), (B, 3) and one placement (point, direction), both (B, 3), for each target."""

    rotation: np.ndarray
    translation: np.ndarray
    placements: tuple

    def __getitem__(self, chosen) -> "State":
        placements = tuple((p[chosen], d[chosen]) for p, d in self.placements)
        return State(self.rotation[chosen], self.translation[chosen], placements)

    @staticmethod
    def join(first: "State", second: "State") -> "State":
        """Two batches as one."""
        pairs = zip(first.placements, second.placements, strict=True)
        return State(
            np.concatenate([first.rotation, second.rotation]),
            np.concatenate([first.translation, second.translation]),
            tuple((np.concatenate([p, q]), np.concatenate([d, e])) for (p, d), (q, e) in pairs),
        )

    @staticmethod
    def where(mask, first: "State", second: "State") -> "State":
        """`first` where the mask (B,) holds, `second` elsewhere."""

        def pick(a, b):
            return np.where(mask.reshape(-1, *[1] * (a.ndim - 1)), a, b)

        pairs = zip(first.placements, second.placements, strict=True)
        placements = tuple((pick(p, q), pick(d, e)) for (p, d), (q, e) in pairs)
        return State(pick(first.rotation, second.rotation), pick(first.translation, second.translation), placements)


def pose_error(rotation, translation, true_rotation, true_translation) -> np.ndarray:
    """δ (..., 6), mm and rad, sensor frame, with T_true = T · exp(δ) to first order: what the covariance is of."""
    turn = np.swapaxes(rotation, -1, -2) @ true_rotation
    shift = np.swapaxes(rotation, -1, -2) @ (true_translation - translation)[..., None]
    angles = Rotation.from_matrix(turn.reshape(-1, 3, 3)).as_rotvec().reshape(*turn.shape[:-2], 3)
    return np.concatenate([shift[..., 0], angles], axis=-1)
