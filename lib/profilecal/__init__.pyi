# The public names, for type checkers and editors: `PUBLIC` of `__init__.py` once more.
from profilecal.calibration.answer import Answer as Answer
from profilecal.calibration.answer import read_answer as read_answer
from profilecal.calibration.calibrate import calibrate as calibrate
from profilecal.calibration.calibration import Calibration as Calibration
from profilecal.calibration.calibration import write_answer as write_answer
from profilecal.calibration.check_mount import MountCheck as MountCheck
from profilecal.calibration.check_mount import check_mount as check_mount
from profilecal.calibration.self_test import SelfTest as SelfTest
from profilecal.calibration.self_test import self_test as self_test
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

__version__: str

__all__ = [
    "Answer",
    "Ball",
    "Calibration",
    "Disk",
    "Edge",
    "EdgeSolution",
    "MountCheck",
    "Plane",
    "Point",
    "Rod",
    "Scan",
    "ScanError",
    "SelfTest",
    "Truth",
    "TwoStepSolution",
    "UnobservableError",
    "Verification",
    "calibrate",
    "check_mount",
    "pose_matrices",
    "read_answer",
    "read_scan",
    "self_test",
    "simulate",
    "solve_ball",
    "solve_disk",
    "solve_edge",
    "solve_fixed_point",
    "solve_tetra_ball",
    "verify",
    "write_answer",
    "write_scan",
]
