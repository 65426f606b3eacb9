"""Calibration targets, one class a file, each wholly in its own: its geometry, what the joint solution asks of it, how
it is found in raw profiles, simulated, verified and drawn. `target.py` holds the contract and says how to add one.

In: poses, points, profiles as arrays. Out: residuals with their derivatives, features, outlines, lines to draw."""

from profilecal.targets.ball import Ball
from profilecal.targets.disk import Disk
from profilecal.targets.edge import Edge
from profilecal.targets.plane import Plane
from profilecal.targets.point import Point
from profilecal.targets.rod import Rod

TARGETS = {target.kind: target for target in (Edge, Disk, Ball, Plane, Point, Rod)}
