"""A pose as robot controllers take it: the line to paste into one."""

import numpy as np
from numpy.typing import ArrayLike

from profilecal.scan.conventions import from_rotations, named

CONTROLLERS = {  # the convention of its orientations, and what it takes
    "abb": (
        "quaternion",
        "PERS tooldata tScanner:=[{held},[[{x:.4f},{y:.4f},{z:.4f}],"
        "[{qw:.8f},{qx:.8f},{qy:.8f},{qz:.8f}]],"
        "[1,[0,0,1],[1,0,0,0],0,0,0]];  ! set the load",
    ),
    "kuka": (
        "KUKA angles",
        "{{X {x:.4f},Y {y:.4f},Z {z:.4f},A {a:.6f},B {b:.6f},C {c:.6f}}}",
    ),
    "ur": (
        "rotation vector",
        "p[{x_m:.7f},{y_m:.7f},{z_m:.7f},{rx:.8f},{ry:.8f},{rz:.8f}]",
    ),
    "fanuc": (
        "FANUC angles",
        "X {x:.4f}  Y {y:.4f}  Z {z:.4f}  W {w:.6f}  P {p:.6f}  R {r:.6f}",
    ),
    "staubli": (
        "Stäubli angles",
        "{{{x:.4f},{y:.4f},{z:.4f},{alpha:.6f},{beta:.6f},{gamma:.6f}}}",
    ),
    "kawasaki": (
        "Kawasaki angles",
        "{x:.4f} {y:.4f} {z:.4f} {o:.6f} {a:.6f} {t:.6f}",
    ),
    "ros": (
        "quaternion",
        "ros2 run tf2_ros static_transform_publisher --x {x_m:.7f} --y {y_m:.7f} "
        "--z {z_m:.7f} --qx {qx:.8f} --qy {qy:.8f} --qz {qz:.8f} --qw {qw:.8f} "
        "--frame-id {frame} --child-frame-id scanner",
    ),
    "matrix": (
        "matrix",
        "{r11:.9g} {r12:.9g} {r13:.9g} {x:.9g}\n{r21:.9g} {r22:.9g} {r23:.9g} {y:.9g}\n"
        "{r31:.9g} {r32:.9g} {r33:.9g} {z:.9g}\n0 0 0 1",
    ),
}


def check_controller(vendor: str) -> None:
    """Refuse a name that is not among CONTROLLERS, with ValueError."""
    if vendor not in CONTROLLERS:
        known = ", ".join(CONTROLLERS)
        raise ValueError(f"controller is {vendor!r}; expected one of {known}")


def for_controller(vendor: str, pose: ArrayLike, frame: str = "flange") -> str:
    """A pose (4, 4), mm, in the frame "flange" or "base", to paste into a controller.

    Raises ValueError for a controller that is not known.

    >>> for_controller("kuka", np.eye(4))
    '{X 0.0000,Y 0.0000,Z 0.0000,A 0.000000,B 0.000000,C 0.000000}'
    """
    check_controller(vendor)
    convention_name, template = CONTROLLERS[vendor]
    convention = named(convention_name)
    matrix = np.asarray(pose)
    orientation = from_rotations(convention, matrix[None, :3, :3])[0]
    entries = dict(zip(convention.columns, orientation, strict=True))
    for axis, value in zip("xyz", matrix[:3, 3], strict=True):
        entries |= {axis: value, f"{axis}_m": value / 1000}
    held = "TRUE" if frame == "flange" else "FALSE"
    return template.format(frame=frame, held=held, **entries)


def writing_like(convention_name: str) -> str:
    """The first controller whose orientations are in a convention, or "matrix"."""
    for vendor, (name, _) in CONTROLLERS.items():
        if name == convention_name:
            return vendor
    return "matrix"
