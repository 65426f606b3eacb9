"""A pose as robot controllers take it: the line to paste into one.

The command lists them before NumPy is there.
"""

from typing import Any

# the convention of its orientations, and what it takes, to 0.001 mm and about 0.0001°
CONTROLLERS = {
    "abb": (
        "quaternion",
        "PERS tooldata tScanner:=[{held},[[{x:.3f},{y:.3f},{z:.3f}],"
        "[{qw:.6f},{qx:.6f},{qy:.6f},{qz:.6f}]],"
        "[1,[0,0,1],[1,0,0,0],0,0,0]];  ! set the load",
    ),
    "kuka": (
        "KUKA angles",
        "{{X {x:.3f},Y {y:.3f},Z {z:.3f},A {a:.4f},B {b:.4f},C {c:.4f}}}",
    ),
    "ur": (
        "rotation vector",
        "p[{x_m:.6f},{y_m:.6f},{z_m:.6f},{rx:.6f},{ry:.6f},{rz:.6f}]",
    ),
    "fanuc": (
        "FANUC angles",
        "X {x:.3f}  Y {y:.3f}  Z {z:.3f}  W {w:.4f}  P {p:.4f}  R {r:.4f}",
    ),
    "staubli": (
        "Stäubli angles",
        "{{{x:.3f},{y:.3f},{z:.3f},{alpha:.4f},{beta:.4f},{gamma:.4f}}}",
    ),
    "kawasaki": (
        "Kawasaki angles",
        "{x:.3f} {y:.3f} {z:.3f} {o:.4f} {a:.4f} {t:.4f}",
    ),
    "ros": (
        "quaternion",
        "ros2 run tf2_ros static_transform_publisher --x {x_m:.6f} --y {y_m:.6f} "
        "--z {z_m:.6f} --qx {qx:.6f} --qy {qy:.6f} --qz {qz:.6f} --qw {qw:.6f} "
        "--frame-id {frame} --child-frame-id scanner",
    ),
    "matrix": (
        "matrix",
        "{r11:.9g} {r12:.9g} {r13:.9g} {x:.9g}\n{r21:.9g} {r22:.9g} {r23:.9g} {y:.9g}\n"
        "{r31:.9g} {r32:.9g} {r33:.9g} {z:.9g}\n0 0 0 1",
    ),
}


def for_controller(vendor: str, pose: Any, frame: str = "flange") -> str:
    """A pose (4, 4), mm, in the frame "flange" or "base", to paste into one of
    CONTROLLERS.

    >>> import numpy as np
    >>> for_controller("kuka", np.eye(4))
    '{X 0.000,Y 0.000,Z 0.000,A 0.0000,B 0.0000,C 0.0000}'
    """
    from profilecal.scan.conventions import from_rotations, named

    convention_name, template = CONTROLLERS[vendor]
    convention = named(convention_name)
    x, y, z = pose[:3, 3]
    orientation = from_rotations(convention, pose[None, :3, :3])[0]
    entries = dict(zip(convention.columns, orientation, strict=True))
    entries |= {"x": x, "y": y, "z": z}
    entries |= {"x_m": x / 1000, "y_m": y / 1000, "z_m": z / 1000}
    held = "TRUE" if frame == "flange" else "FALSE"
    return template.format(frame=frame, held=held, **entries)


def writing_like(convention_name: str) -> str:
    """The first controller whose orientations are in a convention."""
    return next(v for v, (name, _) in CONTROLLERS.items() if name == convention_name)
