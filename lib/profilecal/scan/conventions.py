"""How robot controllers write an orientation: the columns of a file.

Angles about fixed axes multiply from the right: "xyz" of (w, p, r) is R = Rz(r) Ry(p)
Rx(w).
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from profilecal.geometry.checks import ORTHONORMAL_TOLERANCE
from profilecal.scan.tables import Table, listed


@dataclass(frozen=True)
class Convention:
    """One block of orientation columns."""

    name: str
    columns: tuple[str, ...]
    meaning: str
    # of scipy's Euler angles in degrees, lower case about fixed axes; "" for the others
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
    Convention(
        "matrix",
        tuple(f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)),
        "a matrix",
    ),
)


def find_convention(columns) -> Convention:
    """The one whose columns are all there. Raises ValueError where there is none, or
    more than one.

    >>> find_convention(["pose", "x", "y", "z", "w", "p", "r"]).meaning
    'R = Rz(R) Ry(P) Rx(W)'
    """
    there = [
        convention for convention in CONVENTIONS if {*convention.columns} <= {*columns}
    ]
    if len(there) != 1:
        blocks = "; ".join(", ".join(convention.columns) for convention in CONVENTIONS)
        found = (
            " and ".join(convention.name for convention in there)
            or f"none among {listed(columns)}"
        )
        raise ValueError(
            f"expected one block of orientation columns, {blocks}; found {found}"
        )
    return there[0]


def named(name: str) -> Convention:
    """The convention of that name."""
    return next(convention for convention in CONVENTIONS if convention.name == name)


@np.errstate(over="ignore", invalid="ignore")
def to_rotations(
    convention: Convention, values, table: Table | None = None
) -> np.ndarray:
    """Matrices (n, 3, 3) from a convention's columns (n, k) of a table. Raises
    ScanError for a quaternion not of length one, a rotation vector longer than a full
    turn, angles of more than two turns, a matrix that is no rotation.
    """
    values = np.asarray(values, dtype=float)
    refuse = (
        table or Table(Path("orientations"), {}, range(len(values)), "row")
    ).refuse
    if convention.sequence:
        largest = np.abs(values).max(axis=1)
        refuse(largest > 720, "angle of {:.6g}; expected degrees, at most 720", largest)
        return Rotation.from_euler(
            convention.sequence, values, degrees=True
        ).as_matrix()
    length = np.linalg.norm(values, axis=1)
    if convention.name == "quaternion":  # printed to four decimals, too
        refuse(
            np.abs(length - 1) > 1e-3,
            "quaternion of length {:.4g}; expected length 1",
            length,
        )
        return Rotation.from_quat(values, scalar_first=True).as_matrix()
    if convention.name == "rotation vector":
        sentence = "rotation vector of length {:.4g}; expected radians, at most 2π: are they degrees?"
        refuse(length > 2 * np.pi, sentence, length)
        return Rotation.from_rotvec(values).as_matrix()
    matrices = values.reshape(-1, 3, 3)
    excess, turned = (
        np.abs(matrices @ matrices.mT - np.eye(3)).max(axis=(1, 2)),
        np.linalg.det(matrices),
    )
    off = ~(excess <= ORTHONORMAL_TOLERANCE)
    refuse(
        off, "matrix with R Rᵀ off the identity by {:.2g}; expected a rotation", excess
    )
    refuse(
        turned < 0,
        "matrix with determinant {:.2g}, a reflection; expected a rotation",
        turned,
    )
    return Rotation.from_matrix(matrices).as_matrix()


def from_rotations(convention: Convention, rotations) -> np.ndarray:
    """A block of columns (n, k) from matrices (n, 3, 3)."""
    rotation = Rotation.from_matrix(rotations)
    if convention.sequence:
        return rotation.as_euler(
            convention.sequence, degrees=True, suppress_warnings=True
        )
    if convention.name == "quaternion":
        return rotation.as_quat(canonical=True, scalar_first=True)
    return (
        rotation.as_rotvec()
        if convention.name == "rotation vector"
        else rotation.as_matrix().reshape(-1, 9)
    )
