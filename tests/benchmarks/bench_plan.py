"""Designing a plan of 30 poses, for each target."""

import sys
import time
from pathlib import Path

import numpy as np

from profilecal.plan.plan import Wishes, design

sys.path.append(str(Path(__file__).parents[1]))
from planned import setup_for

LIMIT_S = 10.0


def rows() -> list[dict]:
    """CPU seconds of one design."""
    found = []
    for kind in ("edge", "disk", "ball", "plane", "rod"):
        setup, start = setup_for(kind), time.process_time()
        design(setup, Wishes(poses=30), np.random.default_rng(6))
        ours = time.process_time() - start
        found.append(
            {
                "name": f"plan: 30 poses over a {kind}",
                "ours_s": ours,
                "reference": "ten seconds",
                "reference_s": LIMIT_S,
                "ratio": ours / LIMIT_S,
                "target": "ratio ≤ 1",
                "met": bool(ours <= LIMIT_S),
            }
        )
    return found
