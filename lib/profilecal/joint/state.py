"""The unknowns: sensor poses, and the frames in which the targets stand."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation


@dataclass(frozen=True)
class State:
    """A batch of sensor poses and, for each target, the frame that it stands in."""

    rotation: np.ndarray  # (B, 3, 3)
    translation: np.ndarray  # (B, 3) mm
    placements: tuple  # for each target its origin (B, 3), mm, and axes (B, 3, 3), in columns

    def _each(self, function, *others: "State") -> "State":
        """The state whose arrays are `function` of this one's and the others'."""
        states = (self, *others)
        placements = zip(*(state.placements for state in states), strict=True)
        return State(
            function(*(state.rotation for state in states)),
            function(*(state.translation for state in states)),
            tuple(tuple(function(*arrays) for arrays in zip(*placed, strict=True)) for placed in placements),
        )

    def __getitem__(self, chosen) -> "State":
        return self._each(lambda array: array[chosen])

    def repeat(self, count: int) -> "State":
        """The first problem's state, `count` times."""
        return self[np.zeros(count, dtype=int)]

    def join(self, *others: "State") -> "State":
        """Batches as one."""
        return self._each(lambda *arrays: np.concatenate(arrays), *others)

    def where(self, mask, other: "State") -> "State":
        """This one where the mask (B,) holds, the other elsewhere."""
        return self._each(lambda a, b: np.where(mask.reshape(-1, *[1] * (a.ndim - 1)), a, b), other)


def pose_error(rotation, translation, true_rotation, true_translation) -> np.ndarray:
    """δ (..., 6), mm and rad, sensor frame, with T_true = T · exp(δ) to first order: what the covariance is of."""
    turn = np.swapaxes(rotation, -1, -2) @ true_rotation
    shift = np.swapaxes(rotation, -1, -2) @ (true_translation - translation)[..., None]
    angles = Rotation.from_matrix(turn.reshape(-1, 3, 3)).as_rotvec().reshape(*turn.shape[:-2], 3)
    return np.concatenate([shift[..., 0], angles], axis=-1)


def normalised_square(covariance, error) -> np.ndarray:
    """Errors (..., 6) squared over their covariances (..., 6, 6): follows χ² with 6 degrees of freedom if honest."""
    return np.einsum("...i,...i", error, np.linalg.solve(covariance, error[..., None])[..., 0])
