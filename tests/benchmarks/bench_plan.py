"""Designing a plan of 30 poses, for each target."""

import sys
import time
from pathlib import Path

import numpy as np

from profilecal.plan.candidates import Limits
from profilecal.plan.design import design

sys.path.append(str(Path(__file__).parents[1]))
from planned import model_for

LIMIT_S = 10.0


def rows() -> list[dict]:
    """CPU seconds of one design."""
    found = []
    for kind in ("edge", "disk", "ball", "plane", "rod"):
        model, start = model_for(kind), time.process_time()
        design(model, Limits(), np.random.default_rng(6), poses=30)
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
