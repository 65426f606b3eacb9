"""Random scenes of every target as batches, and their errors."""

import functools

import numpy as np
from numpy.random import default_rng

from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import pose_error
from profilecal.simulation.scene import Scene, random_scene
from profilecal.targets import TARGETS
from profilecal.targets.state import State
from profilecal_papers.batches import stack

KINDS = list(TARGETS)
IN_PROFILES = [kind for kind in KINDS if "profiles" in TARGETS[kind].tables]
SMALL = {"disk": {"positions": 20}}
SIGMA = 0.05
KNOWN = Noise(SIGMA, steering_mm=0.2)


@functools.cache
def many(kind: str, count: int, seed: int, **choices) -> Scene:
    """`count` random scenes as a batch."""
    rng = default_rng(seed)
    choices = SMALL.get(kind, {}) | choices
    scenes = [random_scene(kind, rng, count=10, **choices) for _ in range(count)]
    return stack(scenes)


def errors(state: State, truth: State) -> np.ndarray:
    """Of sensor poses (B, 6), mm and rad."""
    return pose_error(
        state.rotation, state.translation, truth.rotation, truth.translation
    )
