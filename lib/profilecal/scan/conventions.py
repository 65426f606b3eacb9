"""How robot controllers write an orientation, and a pose: columns in a file, lines to
paste into a controller.

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
    controller: str  # of CONTROLLERS, one that writes orientations like this
    # of scipy's Euler angles in degrees, lower case about fixed axes; "" for the others
    sequence: str = ""


CONVENTIONS = (
    Convention(
        "quaternion", ("qw", "qx", "qy", "qz"), "a quaternion", "abb"
    ),  # ROS too
    Convention("rotation vector", ("rx", "ry", "rz"), "a rotation vector", "ur"),
    Convention("KUKA angles", ("a", "b", "c"), "R = Rz(A) Ry(B) Rx(C)", "kuka", "ZYX"),
    Convention(
        "FANUC angles", ("w", "p", "r"), "R = Rz(R) Ry(P) Rx(W)", "fanuc", "xyz"
    ),  # Yaskawa too
    Convention(
        "Stäubli angles",
        ("alpha", "beta", "gamma"),
        "R = Rx(alpha) Ry(beta) Rz(gamma)",
        "staubli",
        "XYZ",
    ),
    Convention(
        "matrix",
        tuple(f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)),
        "a matrix",
        "matrix",
    ),
)
CONTROLLERS = {  # how a pose is pasted into one
    "abb": (
        "PERS tooldata tScanner:=[{held},[[{x:.4f},{y:.4f},{z:.4f}],[{qw:.8f},{qx:.8f},{qy:.8f},{qz:.8f}]],"
        "[1,[0,0,1],[1,0,0,0],0,0,0]];  ! set the load"
    ),
    "kuka": "{{X {x:.4f},Y {y:.4f},Z {z:.4f},A {a:.6f},B {b:.6f},C {c:.6f}}}",
    "ur": "p[{x_m:.7f},{y_m:.7f},{z_m:.7f},{rx:.8f},{ry:.8f},{rz:.8f}]",
    "fanuc": "X {x:.4f}  Y {y:.4f}  Z {z:.4f}  W {w:.6f}  P {p:.6f}  R {r:.6f}",
    "staubli": "{{{x:.4f},{y:.4f},{z:.4f},{alpha:.6f},{beta:.6f},{gamma:.6f}}}",
    "ros": (
        "ros2 run tf2_ros static_transform_publisher --x {x_m:.7f} --y {y_m:.7f} --z {z_m:.7f} --qx {qx:.8f} "
        "--qy {qy:.8f} --qz {qz:.8f} --qw {qw:.8f} --frame-id {frame} --child-frame-id scanner"
    ),
    "matrix": (
        "{r11:.9g} {r12:.9g} {r13:.9g} {x:.9g}\n{r21:.9g} {r22:.9g} {r23:.9g} {y:.9g}\n"
        "{r31:.9g} {r32:.9g} {r33:.9g} {z:.9g}\n0 0 0 1"
    ),
}


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


def for_controller(vendor: str, matrix, frame: str = "flange") -> str:
    """A pose (4, 4), mm, in the frame "flange" or "base", to paste into a controller.
    Raises ValueError for others.

    >>> for_controller("kuka", np.eye(4))
    '{X 0.0000,Y 0.0000,Z 0.0000,A 0.000000,B 0.000000,C 0.000000}'
    """
    if vendor not in CONTROLLERS:
        raise ValueError(
            f"controller is {vendor!r}; expected one of {', '.join(CONTROLLERS)}"
        )
    entries = {"frame": frame, "held": "TRUE" if frame == "flange" else "FALSE"}
    for axis, value in zip("xyz", matrix[:3, 3], strict=True):
        entries |= {axis: value, f"{axis}_m": value / 1000}
    for convention in CONVENTIONS:
        entries |= zip(
            convention.columns,
            from_rotations(convention, matrix[None, :3, :3])[0],
            strict=True,
        )
    return CONTROLLERS[vendor].format(**entries)
