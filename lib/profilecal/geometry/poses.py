"""Rotations and rigid transforms, directions, frames and circles; in batches."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy import ndarray
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

# orientations (..., 3, 3), axes in columns, and origins (..., 3), mm
Frames = tuple[ndarray, ndarray]
SAME_ORIENTATION_DEG = 0.05  # poses that differ by less form a rotation group
LARGEST_IN_GROUP_DEG = 1.0  # poses that differ by more form none, whoever says so


def rotation_from_xyz_angles(angles: ndarray) -> ndarray:
    """R = Rz(c) Ry(b) Rx(a), (..., 3, 3), of angles (a, b, c), (..., 3) rad.

    The disk paper calls these "ZYX Euler angle".
    """
    return Rotation.from_euler("xyz", angles).as_matrix()


def nearest_rotation(matrix: ndarray) -> ndarray:
    """The rotations closest to matrices (..., 3, 3) in the Frobenius norm.

    Eq. 27 of the edge paper; never reflections, which Eq. 16 of the disk paper lets
    pass.
    """
    U, _, Vt = np.linalg.svd(matrix)
    # 1 or, of a reflection, -1
    U[..., 2] *= np.linalg.det(U @ Vt)[..., None]
    return U @ Vt


def angle_between(first: ndarray, second: ndarray) -> ndarray:
    """Angles (...), rad, of the rotations that take `first` to `second`, (..., 3, 3).

    ‖A - B‖ = 2√2 sin(θ/2) stays exact near zero, where the trace does not.
    """
    apart = np.linalg.matrix_norm(first - second)
    return 2 * np.arcsin(np.minimum(apart / np.sqrt(8), 1))


def chord(angle_deg: float) -> float:
    """‖A - B‖ of rotation matrices A and B that are so far apart (`angle_between`)."""
    return np.sqrt(8) * np.sin(np.radians(angle_deg) / 2)


def rotation_groups(R: ndarray) -> ndarray:
    """Groups (P,) of orientations (P, 3, 3), which may be rounded.

    A pose joins the first group whose first pose differs from it by no more than
    SAME_ORIENTATION_DEG.
    """
    ways = R.reshape(-1, 9)
    tree, limit = KDTree(ways), chord(SAME_ORIENTATION_DEG)
    group = np.full(len(R), -1)
    for k, way in enumerate(ways):
        if group[k] < 0:
            near = np.array(tree.query_ball_point(way, limit))
            group[near[group[near] < 0]] = group.max() + 1
    return group


def check_alike(name: str, R: ndarray, labels: ndarray) -> ndarray:
    """The number (n,), from 0, of the group that each orientation R (n, 3, 3) has a
    label (n,) of. Raises ValueError where one differs from the first of its label by
    more than 1°. `name` is the argument that holds R.
    """
    _, first, number = np.unique(labels, return_index=True, return_inverse=True)
    first = first[number]
    apart = np.degrees(angle_between(R, R[first]))
    for k in np.flatnonzero(apart > LARGEST_IN_GROUP_DEG):
        raise ValueError(
            f"{name}[{k}] differs from {name}[{first[k]}], which has the same label in "
            f"group, by {apart[k]:.2g}°; expected one orientation"
        )
    return number


def pose_error(
    rotation: ndarray,
    translation: ndarray,
    true_rotation: ndarray,
    true_translation: ndarray,
) -> ndarray:
    """δ (..., 6), mm and rad, sensor frame, with T_true = T · exp(δ) to first order:
    what the covariance is of.
    """
    shift = np.vecmat(true_translation - translation, rotation)
    turn = Rotation.from_matrix(rotation.mT @ true_rotation).as_rotvec()
    return np.concatenate([shift, turn], axis=-1)


def difference(T: ndarray, T_true: ndarray) -> ndarray:
    """The same of poses (4, 4)."""
    return pose_error(T[:3, :3], T[:3, 3], T_true[:3, :3], T_true[:3, 3])


def homogeneous(rotation: ndarray, translation: ndarray) -> ndarray:
    """4×4 matrices (..., 4, 4) from rotations (..., 3, 3) and translations (..., 3)."""
    batch = np.broadcast_shapes(rotation.shape[:-2], translation.shape[:-1])
    T = np.tile(np.eye(4), (*batch, 1, 1))
    T[..., :3, :3], T[..., :3, 3] = rotation, translation
    return T


def unit(vectors: ndarray) -> ndarray:
    """Vectors (..., k) of length one in the same directions; zero stays zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.maximum(length, 1e-300)


def directions(rng: np.random.Generator, shape: tuple[int, ...]) -> ndarray:
    """Unit vectors (*shape, 3), uniform over the sphere."""
    return unit(rng.normal(size=(*shape, 3)))


def rotations(vectors: ndarray) -> ndarray:
    """Rotation matrices (..., 3, 3) from rotation vectors (..., 3), rad."""
    # scipy is fast along one axis only
    flat = np.reshape(vectors, (-1, 3))
    return Rotation.from_rotvec(flat).as_matrix().reshape(*np.shape(vectors), 3)


def inverse(rotation: ndarray, translation: ndarray) -> Frames:
    """The inverses of rigid transforms (..., 3, 3), (..., 3)."""
    return rotation.mT, -np.vecmat(translation, rotation)


def carry(rotation: ndarray, translation: ndarray, points: ndarray) -> ndarray:
    """Points (..., 3) carried by rigid transforms (..., 3, 3), (..., 3)."""
    return np.matvec(rotation, points) + translation


def in_base(
    T_sensor: ndarray, profiles: Sequence[ndarray], R: ndarray, p: ndarray
) -> tuple[ndarray, ndarray]:
    """Points (N, 3) that profiles (P, n, 2) show by a sensor pose (4, 4) from flange
    poses R (P, 3, 3), p (P, 3), and the number (N,) of the profile that each is of.
    """
    seen = np.concatenate(profiles)
    number = np.repeat(np.arange(len(R)), [*map(len, profiles)])
    there = np.isfinite(seen).all(axis=1)
    number = number[there]
    in_flange = seen[there] @ T_sensor[:3, :3:2].T + T_sensor[:3, 3]
    return carry(R[number], p[number], in_flange), number


def frame_around(axis: ndarray) -> ndarray:
    """Frames (..., 3, 3), in columns, whose z is the unit vector `axis` (..., 3)."""
    z = np.moveaxis(axis, -1, 0)  # by components
    farthest = np.eye(3)[:, np.abs(z).argmin(axis=0)]
    x = unit(np.stack(cross(z, farthest), axis=-1))
    y = np.stack(cross(z, np.moveaxis(x, -1, 0)), axis=-1)
    return np.stack([x, y, axis], axis=-1)


def circle_around(
    centre: ndarray, axis: ndarray, radius: float, count: int = 90
) -> ndarray:
    """Points (count, 3) on a circle in space around a unit vector."""
    angle = np.linspace(0, 2 * np.pi, count)
    around = np.column_stack([np.cos(angle), np.sin(angle)])
    return centre + radius * around @ frame_around(axis)[:, :2].T


def cross(a: Sequence | ndarray, b: Sequence | ndarray) -> list:
    """a × b of vectors by their components, numbers or arrays: (3,) or (3, ...)."""
    # not by numbers: arrays give their components faster in a row
    (ax, ay, az), (bx, by, bz) = a, b
    return [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx]


def dot(a: Sequence | ndarray, b: Sequence | ndarray) -> Any:
    """a · b of vectors by their components, numbers or arrays: (3,) or (3, ...)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def root(square: ndarray, least: float | ndarray) -> tuple[ndarray, ndarray]:
    """The square root and its derivative, continued as its tangent below `least`².

    A scan plane that misses a ball or a disk has no circle or chord, but a solver that
    tries it needs a residual that leads back.

    The tangent at r² has the slope 1 / 2r and is r + (square - r²) / 2r, which is the
    root itself where r is.
    """
    r = np.sqrt(np.fmax(square, least**2))
    return (r + square / r) / 2, 0.5 / r
