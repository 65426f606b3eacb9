"""Hand-eye calibration of 2D laser profile scanners on robots.

>>> import profilecal as pc
>>> scan, truth = pc.simulate("edge", seed=1)  # or pc.read_scan, or pc.Scan.of
>>> found = pc.calibrate(scan)
>>> found.status
'ok'
>>> found.pose.shape, found.covariance_mm_deg.shape
((4, 4), (6, 6))

The names below are the library. They load what they need when they are first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

PUBLIC = {  # by the module that has them
    # scans
    "scan.scan": ["Scan"],
    "scan.tables": ["ScanError"],
    "scan.conventions": ["pose_matrices"],
    "scan.folder": ["read_scan", "write_scan"],
    "simulation.spec": ["simulate", "Truth"],
    # one calibration for every target
    "calibration.observe": ["check"],
    "calibration.calibration": ["calibrate", "Calibration"],
    "calibration.leave_out": ["leave_out", "LeftOut"],
    "calibration.verify": ["verify", "Verification"],
    "calibration.answer": ["read_answer", "Answer"],
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

if TYPE_CHECKING:  # the same once more, for type checkers and editors
    from profilecal.calibration.answer import Answer as Answer
    from profilecal.calibration.answer import read_answer as read_answer
    from profilecal.calibration.calibration import Calibration as Calibration
    from profilecal.calibration.calibration import calibrate as calibrate
    from profilecal.calibration.leave_out import LeftOut as LeftOut
    from profilecal.calibration.leave_out import leave_out as leave_out
    from profilecal.calibration.observe import check as check
    from profilecal.calibration.verify import Verification as Verification
    from profilecal.calibration.verify import verify as verify
    from profilecal.closed_form.ball import solve_ball as solve_ball
    from profilecal.closed_form.ball import solve_fixed_point as solve_fixed_point
    from profilecal.closed_form.ball import solve_tetra_ball as solve_tetra_ball
    from profilecal.closed_form.disk import solve_disk as solve_disk
    from profilecal.closed_form.edge import EdgeSolution as EdgeSolution
    from profilecal.closed_form.edge import solve_edge as solve_edge
    from profilecal.closed_form.two_step import TwoStepSolution as TwoStepSolution
    from profilecal.geometry.checks import UnobservableError as UnobservableError
    from profilecal.scan.conventions import pose_matrices as pose_matrices
    from profilecal.scan.folder import read_scan as read_scan
    from profilecal.scan.folder import write_scan as write_scan
    from profilecal.scan.scan import Scan as Scan
    from profilecal.scan.tables import ScanError as ScanError
    from profilecal.simulation.spec import Truth as Truth
    from profilecal.simulation.spec import simulate as simulate
    from profilecal.targets.ball import Ball as Ball
    from profilecal.targets.disk import Disk as Disk
    from profilecal.targets.edge import Edge as Edge
    from profilecal.targets.plane import Plane as Plane
    from profilecal.targets.point import Point as Point
    from profilecal.targets.rod import Rod as Rod


def __getattr__(name: str) -> Any:
    """A public name, from where it stands, when it is first used."""
    if name not in PLACE:
        raise AttributeError(f"module 'profilecal' has no attribute {name!r}")
    value = getattr(import_module(f"profilecal.{PLACE[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
