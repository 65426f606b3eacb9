"""Hand-eye calibration of 2D laser profile scanners on robots.

>>> import profilecal as pc
>>> scan, truth = pc.simulate("edge", seed=1)  # or pc.read_scan, or pc.Scan.of
>>> found = pc.calibrate(scan)
>>> found.status
'ok'
>>> found.pose.shape, found.covariance_mm_deg.shape
((4, 4), (6, 6))

The names below are the library. Each is loaded when it is first used; `__init__.pyi`
names them for type checkers and editors.
"""

from importlib import import_module, metadata
from typing import Any

PUBLIC = {  # by the module that has them
    # scans
    "scan.scan": ["Scan"],
    "scan.tables": ["ScanError"],
    "scan.conventions": ["pose_matrices"],
    "scan.folder": ["read_scan", "write_scan"],
    "simulation.spec": ["simulate", "Truth"],
    # one calibration for every target
    "calibration.calibrate": ["calibrate"],
    "calibration.calibration": ["Calibration", "write_answer"],
    "calibration.self_test": ["self_test", "SelfTest"],
    "calibration.verify": ["verify", "Verification"],
    "calibration.answer": ["read_answer", "Answer"],
    "calibration.check_mount": ["check_mount", "MountCheck"],
    "geometry.checks": ["UnobservableError"],
    # the papers' methods
    "closed_form.edge": ["solve_edge", "EdgeSolution"],
    "closed_form.disk": ["solve_disk"],
    "closed_form.ball": ["solve_ball", "solve_tetra_ball", "solve_fixed_point"],
    "closed_form.two_step": ["TwoStepSolution"],
    # targets in their place
    "targets": ["Edge", "Disk", "Ball", "Plane", "Point", "Rod"],
}
PLACE = {name: module for module, names in PUBLIC.items() for name in names}

__all__ = [*PLACE]


def __getattr__(name: str) -> Any:
    """A public name, from where it stands, when it is first used."""
    if name == "__version__":
        value = metadata.version("profilecal")
    elif name in PLACE:
        value = getattr(import_module(f"profilecal.{PLACE[name]}"), name)
    else:
        raise AttributeError(f"module 'profilecal' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
