"""The edge method's closed form against its time limit."""

import numpy as np
from bench import at_most, least

import profilecal as pc
from profilecal.geometry.noise import Noise
from profilecal_papers.edge_study import EdgePlan, edge_scenes

LIMIT_S = 5e-3


def rows() -> list[dict]:
    """One calibration of 25 rotations x 10 translations."""
    plan = EdgePlan(motion="space")
    scene = edge_scenes(plan, Noise(0.05), np.random.default_rng(13))
    positions = scene.poses.positions
    R = np.repeat(scene.poses.rotations, positions.shape[1], axis=0)
    T = positions.reshape(-1, 3)
    points = scene.points.reshape(-1, 2)
    (ours,) = least(lambda: pc.solve_edge(R, T, points), repeats=50)
    return [at_most(1, "edge: closed form, 25 x 10", ours, "limit", LIMIT_S)]
