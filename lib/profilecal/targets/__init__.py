"""Calibration targets, one class a file: its geometry, its residuals, a start for them, how it is simulated and drawn.
How it is found in raw profiles is a function of `profiles`, which the class names. `target.py` holds the contract and
says how to add one.

In: poses, points, profiles as arrays. Out: residuals with their derivatives, features, outlines, lines to draw."""

from profilecal.targets.ball import Ball
from profilecal.targets.disk import Disk
from profilecal.targets.edge import Edge
from profilecal.targets.plane import Plane
from profilecal.targets.point import Point
from profilecal.targets.rod import Rod

TARGETS = {target.kind: target for target in (Edge, Disk, Ball, Plane, Point, Rod)}
