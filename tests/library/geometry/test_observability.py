"""What the motions leave open is flagged, with noise, in the right direction; healthy
motions are not.
"""

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose

from profilecal.geometry.noise import Noise
from profilecal.geometry.observability import (
    Spectrum,
    brief,
    explain,
    name_axis,
    name_direction,
    spectrum,
    turns,
)
from profilecal.geometry.poses import rotations
from profilecal.simulation.scene import random_scene
from profilecal_papers.batches import stack
from profilecal_papers.monte_carlo import estimate

SIGMA = 0.05
KNOWN = Noise(SIGMA, steering_mm=0.2)
SMALL = {
    "edge": {"groups": 10, "positions": 5},
    "disk": {"positions": 12},
    "ball": {"count": 8},
    "plane": {"count": 8},
    "rod": {"count": 8},
    "point": {"positions": 4},
}
Z = np.array([0.0, 0.0, 1.0])  # of the base
# what a measurement by hand is good to, mm and rad
BY_HAND = np.repeat([10.0, np.radians(5.0)], 3)
# what is chosen, and the free direction: "all" translations, or along the axis that all
# turns share
MOTIONS = {
    "one orientation": ({"spread_deg": 0.0}, "all"),
    "one axis": ({"axis": Z}, "axis"),
    "two orientations": ({"groups": 2}, "axis"),
    # the disk paper: all D equal
    "about the target's direction": ({"about_target": True}, "axis"),
}


def test_a_size_in_a_sentence_has_no_exponent():
    sizes = map(brief, (0.0123, 99.4, 99.6, -153.2))
    assert [*sizes] == ["0.012", "99", "100", "-153"]


def judged(kind, seed, scene_count, **choices):
    """Spectra of noisy random scenes, with the flange orientations (count, P, 3, 3) and
    the estimated states.
    """
    rng = default_rng(seed)
    settings = SMALL.get(kind, {}) | {"steering_mm": 0.2 * (kind == "point")} | choices
    scene = stack([random_scene(kind, rng, **settings) for _ in range(scene_count)])
    seen = scene.noisy(SIGMA, rng)
    state, found, _ = estimate([seen], KNOWN, scene.truth, steps=8)
    return found, seen.R_flange, state


def shared_axis(R_flange, R_sensor):
    """The axis that all orientations turn about, in the sensor frames, (count, 3)."""
    return np.array(
        [R.T @ turns(flange)[1] for flange, R in zip(R_flange, R_sensor, strict=True)]
    )


CASES = [
    (kind, name)
    for kind in ("edge", "disk", "ball", "point", "rod")
    for name in MOTIONS
    if kind in ("edge", "disk", "rod") or "target" not in name
]


@pytest.mark.parametrize(("kind", "name"), CASES)
def test_degenerate_motions_are_flagged_with_the_direction_they_leave_open(kind, name):
    choices, free = MOTIONS[name]
    found, R_flange, state = judged(kind, 31, 100, **choices)
    assert (found.status == "unobservable").all()
    worst = found.directions[:, 0]
    if free == "axis":
        axes = shared_axis(R_flange, state.rotation)
        along = np.abs(np.vecdot(worst[:, :3], axes))
        assert (along > np.cos(np.radians(5))).all()
    else:  # all three translations lie in the span of the directions that are left open
        for k in range(0, 100, 5):
            open_ones = found.directions[k][found.sd[k] > 1]
            assert np.linalg.norm(open_ones[:, :3], axis=0).min() > 0.99


@pytest.mark.parametrize(
    "choices", [{"axis": Z}, {"about_target": True}, {"groups": 3, "positions": 10}]
)
def test_a_single_plane_with_motions_that_leave_its_gauge_free_is_flagged(choices):
    found, _, _ = judged("plane", 32, 100, **choices)
    assert (found.status != "ok").all()


@pytest.mark.parametrize("kind", ["edge", "disk", "ball", "plane", "point", "rod"])
def test_healthy_motions_are_not_flagged(kind):
    """None of 300: fewer than 1 % at 95 % confidence (the rule of three)."""
    settings = {"edge": {"groups": 25, "positions": 10}}
    found, _, _ = judged(kind, 33, 300, count=20, **settings.get(kind, {}))
    assert (found.status == "ok").all()


def test_thresholds():
    sd = np.tile(0.01 * BY_HAND, (5, 1))
    sd[:, 0] = 0.5, 0.99, 1.01, 9.9, 10.1
    of_target = np.insert(sd**-2, 6, 0, axis=1)  # which is left open
    information = np.apply_along_axis(np.diag, 1, of_target)
    found = spectrum(information, np.append(BY_HAND, 10))
    assert found.status.tolist() == [*["ok"] * 2, *["weak"] * 2, "unobservable"]


def test_words():
    assert name_axis([0.1, 0.0, -1.0], "flange") == "the flange's z"
    said = name_axis([0.0, -0.6, 0.8], "flange")
    assert said == "(0.00, -0.60, 0.80) in the flange's frame"
    said = name_direction([0, 0, 0.6, 0.8, 0, 0], np.eye(3), "flange")
    assert said == "rotation about the flange's x with translation along the flange's z"
    still = np.eye(3)[None].repeat(4, axis=0)
    open_sd = np.repeat([1e4, 0.01], 3)
    found = Spectrum(np.eye(6), open_sd, np.eye(6), True)
    (said,) = explain(found, np.eye(3), still, "flange")
    assert said.startswith(
        "translation in every direction cannot be determined (left open): "
        "all flange orientations"
    )
    known = replace(found, sd=open_sd / 1e6, is_open=False)
    assert explain(known, np.eye(3), still, "flange") == []


@pytest.mark.parametrize("k", range(3))
def test_turns_are_told_about_the_axis_they_are_about(k):
    """Turns of up to 30° about one axis of the flange, from any start; then two poses
    more, by 5° about another.
    """
    start, own = rotations([0.4, -0.8, 1.1]), np.eye(3)[[k, (k + 1) % 3]]
    one = np.radians([-30, -10, 0, 10, 30])[:, None] * own[0]
    angles, axis = turns(start @ rotations(one))
    expected = np.degrees(np.std(one[:, k]))
    assert_allclose(angles, [expected, 0, 0], atol=1e-6)
    assert abs(axis[k]) > 1 - 1e-12
    two = np.vstack([one, np.radians([[-5], [5]]) * own[1]])
    weak = Spectrum(np.eye(6), np.r_[0.5, np.full(5, 0.01)], np.eye(6), False)
    others = " or ".join("xyz".replace("xyz"[k], ""))
    tilt = f"; tilt the flange about its {others} by 15° or more in some poses"
    named, small = f"about the flange's {'xyz'[k]}", f"{np.sqrt(2 / 7) * 5:.2g}"
    only = f"but for turns {named}, the orientations differ by only {small}°"
    for turned, why in ((one, f"all rotations are {named}"), (two, only)):
        (said,) = explain(weak, np.eye(3), start @ rotations(turned), "flange")
        assert said.endswith(f": {why}{tilt}")
