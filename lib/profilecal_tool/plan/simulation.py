"""Scans of a specification with a guess: at random poses, or those of a plan."""

import numpy as np
from numpy import ndarray

from profilecal.scan.scan import Scan
from profilecal.simulation.scene import Scene, Setup
from profilecal.simulation.spec import (
    errors_of,
    record,
    record_sweeps,
    simulate_scan,
    taken,
)
from profilecal.simulation.sweeps import Sweep
from profilecal_tool.plan.specification import PlannedSpec, planned_poses


def simulate_specification(spec: PlannedSpec) -> Scan:
    """The scan that a robot and a scanner with errors would record.

    Raises ScanError where it shows nothing.
    """
    if not spec.poses:
        return simulate_scan(spec)
    rng = np.random.default_rng(spec.seed)
    setup = spec.setup(rng)
    rng = errors_of(spec, rng)
    said, R, T = planned_poses(spec.poses, spec.to_hand)
    if spec.motion:
        sweeps = straight_sweeps(setup, R, T, spec.motion.speed)
        return record_sweeps(setup, spec, rng, sweeps)
    if setup.target.steered:  # by the operator, as far as this takes
        R_view, T_view = setup.planes(R, T)
        across = R_view[..., 1]
        off = np.vecdot(setup.target.frame[0] - T_view, across)
        off = off - spec.noise.steering_mm * rng.normal(size=len(T))
        T = T + off[:, None] * across
    scene = Scene.of(setup, (R, T[:, None]), said["labels"], said["group"])
    return record(scene, taken(scene, spec, rng), spec, rng)


def straight_sweeps(setup: Setup, R: ndarray, T: ndarray, speed: float) -> list[Sweep]:
    """The straight sweeps at a speed, mm/s, between flange poses (2 n, 3, 3), (2 n, 3),
    two of each, of a sensor that is where `setup` has it.
    """
    R_view, T_view = setup.planes(R, T)
    sweeps = []
    for facing, begin, end in zip(R_view[::2], T_view[::2], T_view[1::2], strict=True):
        half = float(np.linalg.norm(end - begin)) / 2
        along = (end - begin) / (2 * half)
        sweeps.append(Sweep((begin + end) / 2, facing, along, speed, half))
    return sweeps
