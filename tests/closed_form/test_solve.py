"""The papers' methods on batches of what the joint calibration takes."""

import numpy as np
import pytest

from profilecal.closed_form import closed_form
from profilecal.joint.observations import pose_error
from profilecal.simulate.scene import random_scene


@pytest.mark.parametrize("kind", ["edge", "disk"])
@pytest.mark.parametrize("how", ["published", "regression"])
def test_a_batch_without_noise_is_solved_exactly(kind, how):
    scene = random_scene(kind, np.random.default_rng(4))
    seen, truth = scene.noisy(0.0, np.random.default_rng(5), 3), scene.truth.repeat(3)
    found = closed_form(seen, truth.rotation, how)
    assert found.R_sensor.shape == (3, 3, 3)
    assert np.abs(pose_error(found.R_sensor, found.T_sensor, truth.rotation, truth.translation)).max() < 1e-7
