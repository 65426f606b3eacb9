"""Rotations and rigid transforms, in batches; directions, frames and circles in space."""

import numpy as np
from scipy.spatial.transform import Rotation

SAME_ORIENTATION_DEG = 0.05  # poses that differ by less form a rotation group


def rotation_from_xyz_angles(angles) -> np.ndarray:
    """R = Rz(c) Ry(b) Rx(a), (..., 3, 3), of angles (a, b, c), (..., 3) rad: the disk
    paper's "ZYX Euler angle".
    """
    return Rotation.from_euler("xyz", angles).as_matrix()


def xyz_angles_from_rotation(matrix) -> np.ndarray:
    """The angles (a, b, c) in radians, (..., 3), of R = Rz(c) Ry(b) Rx(a); a in [0,
    2π), which does not jump near π.
    """
    angles = Rotation.from_matrix(matrix).as_euler("xyz")
    angles[..., 0] %= 2 * np.pi
    return angles


def nearest_rotation(matrix) -> np.ndarray:
    """The rotations closest to matrices (..., 3, 3) in the Frobenius norm (edge paper,
    Eq. 27); never reflections, which Eq. 16 of the disk paper lets pass.
    """
    U, _, Vt = np.linalg.svd(np.asarray(matrix, dtype=float))
    U[..., :, 2] *= np.sign(np.linalg.det(U @ Vt))[..., None]
    return U @ Vt


def angle_between(first, second) -> np.ndarray:
    """Angles, rad, of the rotations that take `first` to `second`, both (..., 3, 3),
    from ‖A - B‖ = 2√2 sin(θ/2), which stays exact near zero where the trace does not.
    """
    chord = np.linalg.norm(np.asarray(first) - np.asarray(second), axis=(-2, -1))
    return 2 * np.arcsin(np.clip(chord / np.sqrt(8), 0, 1))


def parallel(first, second, within_deg: float) -> np.ndarray:
    """Which orientations (N, 3, 3) differ from which (M, 3, 3) by less than an angle of
    0.001° or more, (N, M).
    """
    return first.reshape(-1, 9) @ second.reshape(-1, 9).T > 1 + 2 * np.cos(
        np.radians(within_deg)
    )


def rotation_groups(R: np.ndarray) -> np.ndarray:
    """Groups (P,) of orientations (P, 3, 3), which may be rounded.

    A pose joins the first group whose first pose it is parallel to.
    """
    R = nearest_rotation(R)
    group = np.full(len(R), -1)
    count = 0
    while (free := group < 0).any():
        alike = parallel(R, R[free.argmax()], SAME_ORIENTATION_DEG)[:, 0]
        group[free & alike] = count
        count += 1
    return group


def pose_error(rotation, translation, true_rotation, true_translation) -> np.ndarray:
    """δ (..., 6), mm and rad, sensor frame, with T_true = T · exp(δ) to first order:
    what the covariance is of.
    """
    turn = rotation.mT @ true_rotation
    shift = rotation.mT @ (true_translation - translation)[..., None]
    return np.concatenate(
        [shift[..., 0], Rotation.from_matrix(turn).as_rotvec()], axis=-1
    )


def homogeneous(rotation, translation) -> np.ndarray:
    """4×4 matrices (..., 4, 4) from rotations (..., 3, 3) and translations (..., 3)."""
    rotation, translation = (
        np.asarray(rotation, dtype=float),
        np.asarray(translation, dtype=float),
    )
    shape = np.broadcast_shapes(rotation.shape[:-2], translation.shape[:-1])
    matrix = np.zeros((*shape, 4, 4))
    matrix[..., :3, :3], matrix[..., :3, 3], matrix[..., 3, 3] = (
        rotation,
        translation,
        1,
    )
    return matrix


def directions(rng: np.random.Generator, shape) -> np.ndarray:
    """Unit vectors (*shape, 3), uniform over the sphere."""
    vectors = rng.normal(size=(*shape, 3))
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def rotations(vectors) -> np.ndarray:
    """Rotation matrices (..., 3, 3) from rotation vectors (..., 3), rad."""
    return Rotation.from_rotvec(vectors).as_matrix()


def random_turns(
    rng: np.random.Generator, shape, spread: float, axis=None
) -> np.ndarray:
    """Rotations (*shape, 3, 3) by uniform angles up to ±`spread`, rad, about random
    axes or about `axis` (..., 3).
    """
    angle = rng.uniform(-spread, spread, (*shape, 1))
    return rotations(angle * (directions(rng, shape) if axis is None else axis))


def frame_along(direction, angle) -> np.ndarray:
    """Frames (..., 3, 3), in columns, whose second axis is `direction` (..., 3);
    `angle` (...) turns them about it.
    """
    x, aside, y = np.moveaxis(frame_around(direction), -1, 0)
    angle = np.asarray(angle)[..., None]
    x = np.cos(angle) * x + np.sin(angle) * aside
    return np.stack(np.broadcast_arrays(x, y, np.cross(x, y)), axis=-1)


def inverse(rotation, translation) -> tuple[np.ndarray, np.ndarray]:
    """The inverses of rigid transforms (..., 3, 3), (..., 3)."""
    back = rotation.mT
    return back, -(back @ translation[..., None])[..., 0]


def carry(rotation, translation, points) -> np.ndarray:
    """Points (..., 3) carried by rigid transforms (..., 3, 3), (..., 3)."""
    return (rotation @ points[..., None])[..., 0] + translation


def frame_around(axis) -> np.ndarray:
    """Frames (..., 3, 3), in columns, whose z is the unit vector `axis` (..., 3)."""
    axis = np.asarray(axis, dtype=float)
    away = np.eye(3)[np.argmin(np.abs(axis), axis=-1)]
    z, away = ([vector[..., k] for k in range(3)] for vector in (axis, away))
    x = cross(z, away)
    x = [component / np.sqrt(dot(x, x)) for component in x]
    return np.stack(
        [np.stack(column, axis=-1) for column in (x, cross(z, x), z)], axis=-1
    )


def circle_around(centre, axis, radius: float, count: int = 90) -> np.ndarray:
    """Points (count, 3) on a circle in space; its axis need not have length one."""
    frame = frame_around(np.asarray(axis, dtype=float) / np.linalg.norm(axis))
    angle = np.linspace(0, 2 * np.pi, count)[:, None]
    return centre + radius * (np.cos(angle) * frame[:, 0] + np.sin(angle) * frame[:, 1])


def cross(a, b) -> list:
    """a × b."""
    return [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]


def dot(a, b):
    """a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def root(square, least):
    """The square root and its derivative, continued as its tangent below `least`²: a
    scan plane that misses a ball or a disk has no circle or chord, but a solver that
    tries it needs a residual that leads back.
    """
    inside = square > least**2
    value = np.sqrt(np.where(inside, square, least**2))
    slope = 0.5 / value
    return np.where(inside, value, (square + least**2) * slope), slope
