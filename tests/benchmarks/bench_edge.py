"""The edge method's closed form against its time limit."""

import time

import numpy as np

from profilecal.closed_form.edge import edge_equations
from profilecal.geometry.noise import Noise
from profilecal.papers.edge_study import EdgePlan, edge_scenes

LIMIT_S = 5e-3


def rows() -> list[dict]:
    """One calibration of 25 rotations x 10 translations."""
    scene = edge_scenes(EdgePlan(motion="space"), Noise(0.05), np.random.default_rng(13))
    times = []
    for _ in range(50):
        start = time.process_time()
        edge_equations(scene.poses.rotations, scene.poses.positions, scene.points)
        times.append(time.process_time() - start)
    ours = float(np.median(times))
    return [
        {
            "name": "edge: closed form, 25 x 10",
            "ours_s": ours,
            "reference": "limit",
            "reference_s": LIMIT_S,
            "ratio": ours / LIMIT_S,
            "target": "ratio ≤ 1",
            "met": ours <= LIMIT_S,
        }
    ]
