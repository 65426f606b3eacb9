"""How robot controllers write an orientation: the columns of a file.

Angles about fixed axes multiply from the right: "xyz" of (w, p, r) is R = Rz(r) Ry(p)
Rx(w). Further angles are added by a line in CONVENTIONS. In a log the column `t` is
the time.
"""

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from profilecal.geometry.checks import ORTHONORMAL_TOLERANCE, check_array
from profilecal.geometry.poses import homogeneous, nearest_rotation, rotations
from profilecal.scan.tables import ScanError, Table, listed, naming, shown

UNIT_TOLERANCE = 1e-3  # of a quaternion's length: printed to three decimals
LARGEST_ANGLE_DEG = 720.0


@dataclass(frozen=True)
class Convention:
    """One block of orientation columns."""

    name: str
    columns: tuple[str, ...]
    meaning: str
    # of scipy's Euler angles, in degrees; "" for what are no three angles
    sequence: str = ""


CONVENTIONS = (
    Convention("quaternion", ("qw", "qx", "qy", "qz"), "a quaternion"),
    Convention("rotation vector", ("rx", "ry", "rz"), "a rotation vector"),
    Convention("KUKA angles", ("a", "b", "c"), "R = Rz(A) Ry(B) Rx(C)", "ZYX"),
    Convention("FANUC angles", ("w", "p", "r"), "R = Rz(R) Ry(P) Rx(W)", "xyz"),
    Convention(
        "Stäubli angles",
        ("alpha", "beta", "gamma"),
        "R = Rx(alpha) Ry(beta) Rz(gamma)",
        "XYZ",
    ),
    Convention("Kawasaki angles", ("o", "a", "t"), "R = Rz(O) Ry(A) Rz(T)", "ZYZ"),
    Convention("matrix", tuple(f"r{i}{j}" for i in "123" for j in "123"), "a matrix"),
)


def find_convention(columns: Collection[str]) -> Convention:
    """The convention whose columns are all there.

    Raises ValueError where there is none, or more than one.

    >>> from profilecal.scan.conventions import find_convention
    >>> find_convention(["pose", "x", "y", "z", "w", "p", "r"]).meaning
    'R = Rz(R) Ry(P) Rx(W)'
    """
    found = [one for one in CONVENTIONS if {*columns}.issuperset(one.columns)]
    if len(found) != 1:
        blocks = "; ".join(", ".join(one.columns) for one in CONVENTIONS)
        names = " and ".join(one.name for one in found)
        raise ValueError(
            f"expected one block of orientation columns, {blocks}; "
            f"found {names or f'none among {listed(columns)}'}"
        )
    return found[0]


def named(name: str) -> Convention:
    """The convention of a name. Raises ScanError for one that there is not."""
    for one in CONVENTIONS:
        if one.name == name:
            return one
    raise ScanError(
        f"convention is {shown(name)}; "
        f"expected one of {listed(one.name for one in CONVENTIONS)}"
    )


def pose_matrices(
    positions: ArrayLike, orientations: ArrayLike, convention: str = "quaternion"
) -> ndarray:
    """Poses from positions and from orientations as a robot prints them.

    Parameters
    ----------
    positions : array (P, 3)
        Positions in mm.
    orientations : array (P, k)
        Their orientations, with the columns of the convention, in their order.
    convention : str
        "quaternion" (qw, qx, qy, qz: the scalar first, as ABB has it),
        "rotation vector" (rx, ry, rz in radians: Universal Robots), "KUKA angles" (A,
        B, C in degrees), "FANUC angles" (W, P, R in degrees; Yaskawa too), "Stäubli
        angles" (degrees), "Kawasaki angles" (O, A, T in degrees) or "matrix" (nine
        entries, row by row).

    Returns
    -------
    array (P, 4, 4)
        The poses, for `Scan.of`.

    Raises
    ------
    ScanError
        For arrays of another shape, and for orientations that the convention does not
        have: a quaternion that is not of length 1, angles of more than two turns.

    See Also
    --------
    Scan.of : what takes such poses.

    Examples
    --------
    >>> import profilecal as pc
    >>> pc.pose_matrices([[400, 0, 300]], [[90, 0, 0]], "KUKA angles")[0].round(3)
    array([[  0.,  -1.,   0., 400.],
           [  1.,   0.,   0.,   0.],
           [  0.,   0.,   1., 300.],
           [  0.,   0.,   0.,   1.]])
    """
    block = named(convention)
    with naming("pose_matrices"):
        p = check_array("positions", positions, (None, 3))
        values = check_array("orientations", orientations, (len(p), len(block.columns)))
    return homogeneous(to_rotations(block, values), p)


def to_rotations(
    convention: Convention, values: ArrayLike, table: Table | None = None
) -> ndarray:
    """Matrices (n, 3, 3) from a convention's columns (n, k) of a table.

    Raises ScanError for a quaternion that is not of length one, a rotation vector
    longer than a full turn, angles of more than two turns, a matrix that is no
    rotation.
    """
    block = np.asarray(values, float)
    table = table or Table(Path("orientations"), {}, range(len(block)), "row")
    if convention.sequence:
        angle = np.abs(block).max(axis=1, initial=0.0)
        expected = f"; expected degrees, at most {LARGEST_ANGLE_DEG:g}"
        table.refuse(angle > LARGEST_ANGLE_DEG, "angle of ", angle, expected)
        return Rotation.from_euler(convention.sequence, block, True).as_matrix()
    length = np.linalg.norm(block, axis=1)
    if convention.name == "quaternion":
        is_off = np.abs(length - 1) > UNIT_TOLERANCE
        table.refuse(is_off, "quaternion of length ", length, "; expected length 1")
        return Rotation.from_quat(block, scalar_first=True).as_matrix()
    if convention.name == "rotation vector":
        expected = "; expected radians, at most 2π: are they degrees?"
        table.refuse(length > 2 * np.pi, "rotation vector of length ", length, expected)
        return rotations(block)
    R = block.reshape(-1, 3, 3)
    off = np.abs(R @ R.mT - np.eye(3)).max(axis=(1, 2), initial=0.0)
    size, words = np.linalg.det(R), "matrix with R Rᵀ off the identity by "
    is_none = (off > ORTHONORMAL_TOLERANCE) | (size < 0)
    expected = "; expected a rotation: 0 and 1"
    table.refuse(is_none, words, off, " and determinant ", size, expected)
    return nearest_rotation(R)


def from_rotations(convention: Convention, R: ndarray) -> ndarray:
    """A block of columns (n, k) from matrices (n, 3, 3)."""
    rotation = Rotation.from_matrix(R)
    sequence: Any = convention.sequence
    if sequence:
        # where an angle is open, scipy's choice is as good as any
        return rotation.as_euler(sequence, True, suppress_warnings=True)
    if convention.name == "quaternion":
        return rotation.as_quat(canonical=True, scalar_first=True)
    if convention.name == "rotation vector":
        return rotation.as_rotvec()
    return R.reshape(-1, 9)
