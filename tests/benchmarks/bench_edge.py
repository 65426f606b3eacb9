"""The edge method's closed form against its time limit."""

import numpy as np
from bench import at_most, medians

from profilecal.closed_form.edge import edge_equations
from profilecal.geometry.noise import Noise
from profilecal_papers.edge_study import EdgePlan, edge_scenes

LIMIT_S = 5e-3


def rows() -> list[dict]:
    """One calibration of 25 rotations x 10 translations."""
    scene = edge_scenes(
        EdgePlan(motion="space"), Noise(0.05), np.random.default_rng(13)
    )
    data = scene.poses.rotations, scene.poses.positions, scene.points
    (ours,) = medians(lambda: edge_equations(*data), repeats=50)
    return [at_most(1, "edge: closed form, 25 x 10", ours, "limit", LIMIT_S)]
