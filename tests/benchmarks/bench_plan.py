"""Designing a plan of 30 poses, for each target."""

import numpy as np
from bench import at_most, seconds
from planned import KINDS, model_for

from profilecal_tool.plan.candidates import Limits
from profilecal_tool.plan.design import design

LIMIT_S = 10.0


def rows() -> list[dict]:
    """CPU seconds of one design."""
    found = []
    for kind in KINDS:
        model, rng = model_for(kind), np.random.default_rng(6)
        ours = seconds(
            lambda model=model, rng=rng: design(model, Limits(), rng, poses=30)
        )
        found.append(
            at_most(1, f"plan: 30 poses over a {kind}", ours, "ten seconds", LIMIT_S)
        )
    return found
