"""How robot controllers write an orientation, and a pose: columns in a file, lines to paste into a controller.

Angles about fixed axes multiply from the right: "xyz" of (w, p, r) is R = Rz(r) Ry(p) Rx(w).
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from profilecal.geometry.checks import ORTHONORMAL_TOLERANCE


@dataclass(frozen=True)
class Convention:
    """One block of orientation columns."""

    name: str
    columns: tuple[str, ...]
    unit: str  # deg, rad, or 1
    meaning: str
    sequence: str = ""  # of scipy's Euler angles in degrees, lower case about fixed axes; "" for the others


CONVENTIONS = (
    Convention("quaternion", ("qw", "qx", "qy", "qz"), "1", "a quaternion"),  # ABB, ROS
    Convention("rotation vector", ("rx", "ry", "rz"), "rad", "a rotation vector"),  # Universal Robots
    Convention("KUKA angles", ("a", "b", "c"), "deg", "R = Rz(A) Ry(B) Rx(C)", "ZYX"),
    Convention("FANUC angles", ("w", "p", "r"), "deg", "R = Rz(R) Ry(P) Rx(W)", "xyz"),  # Yaskawa too
    Convention("Stäubli angles", ("alpha", "beta", "gamma"), "deg", "R = Rx(alpha) Ry(beta) Rz(gamma)", "XYZ"),
    Convention("matrix", tuple(f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)), "1", "a matrix"),
)
VENDORS = {
    "abb": "ABB (RAPID)",
    "kuka": "KUKA (KRL)",
    "ur": "Universal Robots (URScript; metres, radians)",
    "fanuc": "FANUC",
    "staubli": "Stäubli (VAL 3)",
    "ros": "ROS 2 (metres)",
    "matrix": "Matrix, mm",
}
UNIT_TOLERANCE = 1e-3  # quaternions printed to four decimals pass
LARGEST_ANGLE_DEG = 720.0  # controllers print angles within a turn


class RowError(ValueError):
    """A row of a table is wrong; `row` counts from 0."""

    def __init__(self, row: int, sentence: str):
        super().__init__(sentence)
        self.row = row


def find_convention(columns) -> Convention:
    """The one whose columns are all there. Raises ValueError where there is none, or more than one.

    >>> find_convention(["pose", "x", "y", "z", "w", "p", "r"]).meaning
    'R = Rz(R) Ry(P) Rx(W)'
    """
    columns = set(columns)
    there = [c for c in CONVENTIONS if columns.issuperset(c.columns)]
    if len(there) == 1:
        return there[0]
    if there:
        blocks = " and ".join(", ".join(c.columns) for c in there)
        raise ValueError(f"two blocks of orientation columns ({blocks}); expected one")
    partly = [c for c in CONVENTIONS if len(c.columns) > 1 and len(columns & set(c.columns)) > 1]
    if partly:
        missing = [name for name in partly[0].columns if name not in columns]
        raise ValueError(f"the orientation lacks {', '.join(missing)} of {', '.join(partly[0].columns)}")
    blocks = "; ".join(", ".join(c.columns) if len(c.columns) < 9 else "r11 … r33" for c in CONVENTIONS)
    raise ValueError(f"no orientation columns; expected one block of: {blocks}")


def named(name: str) -> Convention:
    """The convention of that name."""
    return next(convention for convention in CONVENTIONS if convention.name == name)


@np.errstate(over="ignore", invalid="ignore")
def to_rotations(convention: Convention, values) -> np.ndarray:
    """Matrices (n, 3, 3) from a block of columns (n, k), in the order of the convention.

    Raises ValueError with the row, counted from 0, for a quaternion that is not of length one, a rotation vector
    longer than a full turn, angles of more than two turns, or a matrix that is no rotation.
    """
    values = np.asarray(values, dtype=float)
    if convention.sequence:
        largest = np.abs(values).max(axis=1)
        _refuse(largest > LARGEST_ANGLE_DEG, largest, "angle of {:.6g}; expected degrees, at most 720")
        return Rotation.from_euler(convention.sequence, values, degrees=True).as_matrix()
    if convention.name == "quaternion":
        length = np.linalg.norm(values, axis=1)
        _refuse(np.abs(length - 1) > UNIT_TOLERANCE, length, "quaternion of length {:.4g}; expected length 1")
        return Rotation.from_quat(values, scalar_first=True).as_matrix()
    if convention.name == "rotation vector":
        length = np.linalg.norm(values, axis=1)
        sentence = "rotation vector of length {:.4g}; expected radians, at most 2π: are they degrees?"
        _refuse(length > 2 * np.pi, length, sentence)
        return Rotation.from_rotvec(values).as_matrix()
    matrices = values.reshape(-1, 3, 3)
    excess = np.abs(matrices @ matrices.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    sentence = "matrix with R Rᵀ off the identity by {:.2g}; expected a rotation"
    _refuse(~(excess <= ORTHONORMAL_TOLERANCE), excess, sentence)
    determinant = np.linalg.det(matrices)
    _refuse(determinant < 0, determinant, "matrix with determinant {:.2g}, a reflection; expected a rotation")
    return Rotation.from_matrix(matrices).as_matrix()


def from_rotations(convention: Convention, rotations) -> np.ndarray:
    """A block of columns (n, k) from matrices (n, 3, 3)."""
    rotation = Rotation.from_matrix(np.asarray(rotations, dtype=float))
    if convention.sequence:
        return rotation.as_euler(convention.sequence, degrees=True, suppress_warnings=True)
    if convention.name == "quaternion":
        return rotation.as_quat(canonical=True, scalar_first=True)
    return rotation.as_rotvec() if convention.name == "rotation vector" else rotation.as_matrix().reshape(-1, 9)


def _refuse(bad, values, sentence: str) -> None:
    """Raise RowError for the first row that is bad."""
    if bad.any():
        row = int(np.argmax(bad))
        raise RowError(row, sentence.format(values[row]))


def check_vendor(vendor: str) -> None:
    """Raise ValueError with the names there are."""
    if vendor not in VENDORS:
        raise ValueError(f"controller is {vendor!r}; expected one of {', '.join(VENDORS)}")


def for_controller(vendor: str, matrix, frame: str = "flange") -> str:
    """A pose (4, 4), mm, as a line or lines to paste into a controller or a program. Raises ValueError for others.

    `frame` is the one that the pose is in: "flange", or "base" where the scanner stands still.

    >>> for_controller("kuka", np.eye(4))
    '{X 0.0000,Y 0.0000,Z 0.0000,A 0.000000,B 0.000000,C 0.000000}'
    """
    check_vendor(vendor)
    matrix = np.asarray(matrix, dtype=float)
    T, columns = matrix[:3, 3], {c.name: from_rotations(c, matrix[None, :3, :3])[0] for c in CONVENTIONS}
    qw, *qxyz = columns["quaternion"]
    match vendor:
        case "abb":
            held = "TRUE" if frame == "flange" else "FALSE"
            pose = "[[{:.4f},{:.4f},{:.4f}],[{:.8f},{:.8f},{:.8f},{:.8f}]]".format(*T, qw, *qxyz)
            return f"PERS tooldata tScanner:=[{held},{pose},[1,[0,0,1],[1,0,0,0],0,0,0]];  ! set the load"
        case "kuka":
            return "{{X {:.4f},Y {:.4f},Z {:.4f},A {:.6f},B {:.6f},C {:.6f}}}".format(*T, *columns["KUKA angles"])
        case "ur":
            return "p[{:.7f},{:.7f},{:.7f},{:.8f},{:.8f},{:.8f}]".format(*T / 1000, *columns["rotation vector"])
        case "fanuc":
            return "X {:.4f}  Y {:.4f}  Z {:.4f}  W {:.6f}  P {:.6f}  R {:.6f}".format(*T, *columns["FANUC angles"])
        case "staubli":
            return "{{{:.4f},{:.4f},{:.4f},{:.6f},{:.6f},{:.6f}}}".format(*T, *columns["Stäubli angles"])
        case "ros":
            names = "--x {:.7f} --y {:.7f} --z {:.7f} --qx {:.8f} --qy {:.8f} --qz {:.8f} --qw {:.8f}"
            pose = f"{names.format(*T / 1000, *qxyz, qw)} --frame-id {frame} --child-frame-id scanner"
            return f"ros2 run tf2_ros static_transform_publisher {pose}"
    return "\n".join(" ".join(f"{v:.9g}" for v in row) for row in matrix)
