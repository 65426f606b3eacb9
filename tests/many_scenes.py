"""Random scenes of every target as batches, and their errors."""

import functools

import numpy as np

from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import pose_error
from profilecal.simulation.scene import Scene, random_scene, stack
from profilecal.targets import TARGETS
from profilecal.targets.observations import State

KINDS = list(TARGETS)
SMALL = {"disk": {"positions": 20}}
SIGMA = 0.05
KNOWN = Noise(SIGMA, steering_mm=0.2)


@functools.cache
def many(kind: str, count: int, seed: int, **choices) -> Scene:
    """`count` random scenes as a batch."""
    rng = np.random.default_rng(seed)
    return stack(
        [
            random_scene(kind, rng, count=10, **SMALL.get(kind, {}), **choices)
            for _ in range(count)
        ]
    )


def errors(state: State, truth: State) -> np.ndarray:
    return pose_error(
        state.rotation, state.translation, truth.rotation, truth.translation
    )


def assert_exact(error):
    """1e-9° and 1e-9 mm."""
    assert np.degrees(np.linalg.norm(error[..., 3:], axis=-1)).max() < 1e-9
    assert np.linalg.norm(error[..., :3], axis=-1).max() < 1e-9


def mount_of(scene):
    return scene.truth.rotation[0], scene.truth.translation[0]
