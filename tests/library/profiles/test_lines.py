"""The face of a plane in raw profiles: uneven boards, and real ones."""

import os
import tomllib
from pathlib import Path

import numpy as np
import pytest
from finding import features_of, share_found
from numpy.random import default_rng

import profilecal as pc
from profilecal.geometry.poses import difference

X = np.linspace(-50, 50, 200)


def boards(uneven, count=150, noise_mm=0.05):
    """Profiles of boards on which points are `uneven(rng)` mm high, and their tilts."""
    rng = default_rng(6)
    tilts = rng.uniform(-0.3, 0.3, count)
    noise = rng.normal(0, noise_mm, (count, len(X)))
    z = [200 + tilt * X + uneven(rng) for tilt in tilts]
    return np.stack([np.broadcast_to(X, noise.shape), z + noise], axis=-1), tilts


def printed(rng):
    """Black and white squares of 10 mm, seen 0.3 mm apart."""
    return 0.3 * (np.floor((X + rng.uniform(0, 20)) / 10) % 2) - 0.15


def wavy(rng):
    """Up and down in 80 mm and less."""
    phases = np.exp(2j * np.pi * np.outer(np.arange(1, 6), X / 80))
    sizes = rng.normal(0, 0.15, (5, 2)) @ [1, 1j] / np.arange(1, 6)
    return (sizes @ phases).real


def plate(rng):
    """One of 1 mm on a table."""
    return np.where(rng.uniform(-10, 10) < X, 1.0, 0.0)


@pytest.mark.parametrize(
    ("uneven", "noise_mm"), [(printed, 0.05), (printed, 0.01), (wavy, 0.05)]
)
def test_a_board_that_is_not_quite_flat_is_found_whole_and_weighs_less(
    uneven, noise_mm
):
    profiles, tilts = boards(uneven, noise_mm=noise_mm)
    features = features_of("plane", profiles)
    assert share_found(features) >= 0.99
    found = [pair for pair in zip(features, tilts, strict=True) if pair[0].found]
    squares = []
    for feature, tilt in found:
        assert np.ptp(X[feature.used]) > 60
        x, z = feature.points.T
        off = (z - 200 - tilt * x) / np.hypot(1, tilt)
        weights = 1 / feature.covariance[:, 0, 0]
        # of the mean and of the slope of all points, over what they state of both
        for along in (np.ones_like(x), x - weights @ x / weights.sum()):
            squares.append((weights * along @ off) ** 2 / (weights @ along**2))
    assert np.mean(squares) < 1


def test_a_step_parts_two_faces():
    features = features_of("plane", boards(plate)[0])
    assert share_found(features) == 0
    assert "two straight runs of similar length" in features[0].reason


BOARDS = Path(os.environ.get("PROFILECAL_REAL_DATA", "")) / "etna"


needs_boards = pytest.mark.skipif(
    not BOARDS.is_dir(),
    reason="no real profiles of boards: PROFILECAL_REAL_DATA is not set",
)


@needs_boards
@pytest.mark.parametrize(("name", "least"), [("calib3", 15), ("calib6", 6)])
def test_real_boards_are_found(name, least):
    found = pc.calibrate(pc.read_scan(BOARDS / name))
    assert len(found.to_json()["poses_used"]) >= least


@needs_boards
def test_a_real_board_agrees_with_its_reference():
    """In position and about y, to three stated standard deviations.

    About x and z the reference says how its laser plane lies. The profiles were made
    with that plane: a tilt of it stretches and bends them, and they are seen to be
    stretched. So the reference cannot tell which of both is right there.
    """
    found = pc.calibrate(pc.read_scan(BOARDS / "calib3"))
    reference = tomllib.loads((BOARDS / "calib3" / "reference.toml").read_text())
    apart = abs(difference(found.pose, np.array(reference["T_flange_sensor"])))
    assert (apart[:3] < 3 * found.translation_sd_mm).all()
    assert np.degrees(apart[4]) < 3 * found.rotation_sd_deg[1]
