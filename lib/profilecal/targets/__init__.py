"""Calibration targets, a file each (`plane.py` also has what rods and balls have in
common): geometry, residuals with their derivatives, a start for them, how it is found
(by a function of `profiles`), simulated and drawn. `target.py` holds the contract and
says how to add one, `observations.py` what is seen of any, `state.py` what is unknown.
"""

from profilecal.targets.ball import Ball
from profilecal.targets.disk import Disk
from profilecal.targets.edge import Edge
from profilecal.targets.plane import Plane
from profilecal.targets.point import Point
from profilecal.targets.rod import Rod

TARGETS = {target.kind: target for target in (Edge, Disk, Ball, Plane, Point, Rod)}
