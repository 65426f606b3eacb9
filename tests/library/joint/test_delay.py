"""Scans in motion: the delay between two clocks is found with the pose, or what it
hides is not answered. `PROFILECAL_COVERAGE=60` tries ten scans of each kind.
"""

import os
from dataclasses import replace
from itertools import cycle

import numpy as np
import pytest
from numpy.testing import assert_allclose
from simulated import error_of, state_of

import profilecal as pc
from profilecal.calibration.answer import DEGREES
from profilecal.calibration.observe import observe_all
from profilecal.geometry.noise import Noise, normalised_square
from profilecal.joint import prior
from profilecal.joint.error_sizes import average, likeliest
from profilecal.joint.problem import RESIDUAL, Problem
from profilecal.joint.solve import solve
from profilecal.simulation.spec import truth_of

SMALL = {"sweeps": 8, "profiles": 20}
USUAL = {"profile_mm": 0.05, "group_position_mm": 0.05}
EXACT = {"resolution": 0.0, "quantum": 1e-6}
MOUNTED = [
    *zip(
        ["edge", "plane", "ball", "disk", "rod", "edge"],
        cycle(["eye-in-hand", "eye-to-hand"]),
        strict=False,
    )
]


def driven(
    kind="edge", pattern="weave", seed=1, mount="eye-in-hand", noise=USUAL, **entries
):
    """A scan of few sweeps, and its truth."""
    scanner = {"points": 200} if noise["profile_mm"] else EXACT
    motion = SMALL | {"pattern": pattern} | entries
    return pc.simulate(
        kind, seed=seed, mount=mount, noise=noise, motion=motion, scanner=scanner
    )


def problem_of(scan):
    """Its least squares, at the true delay, and the true state."""
    _, observed, _ = observe_all([scan])
    problem = Problem(observed, Noise(0.05)).later(scan.truth["delay_ms"] / 1000)
    return problem, state_of(truth_of(scan))


@pytest.mark.parametrize(("kind", "mount"), MOUNTED)
def test_the_derivative_by_the_delay_is_that_of_differences(kind, mount):
    """The data are exact, so that points are where the state has them."""
    scan, _ = driven(kind, turn_deg=8.0, mount=mount, noise={"profile_mm": 0.0})
    problem, state = problem_of(scan)
    h = 1e-4  # s
    earlier, there, later = (
        problem.later(shift).columns_in_mm(state)[0][0] for shift in (-h, 0, h)
    )
    by_time = (later[RESIDUAL] - earlier[RESIDUAL]) / (2 * h)
    scale = np.abs(by_time).max()
    assert scale > 20  # mm/s
    assert_allclose(there[problem.clock], by_time, atol=1e-4 * scale)


def test_jitter_that_is_not_known_leaves_the_errors_of_places_known():
    scan, _ = driven()
    problem, state = problem_of(scan)
    model = problem.model(state, ["jitter_ms"])
    usual = prior.Prior(replace(prior.USUAL, profile_mm=0.05))
    sizes = average(model, usual, likeliest(model, usual.law(model.names)))
    assert sizes.sizes[1].low < sizes.sizes[1].high
    assert sizes.freedom == 1000


def test_noise_that_is_stated_too_small_makes_no_delay_better_known():
    """Nor any other of the unknowns, which a solution has at their mean."""
    scan, _ = driven("ball", seed=3, noise={"profile_mm": 0.05})
    _, observed, _ = observe_all([scan])
    known = []
    for stated_mm in (0.005, 0.05):
        solution = solve(observed, Noise(stated_mm))
        mean, covariance = solution.known_of_all
        assert_allclose(mean[: solution.problem.clock + 1], 0, atol=1e-12)
        sd = np.sqrt(np.diag(covariance))[: solution.problem.clock]
        known.append([solution.delay_sd_s, *sd])
    assert_allclose(*known, rtol=0.05)


@pytest.mark.parametrize(
    ("kind", "pattern", "mount"),
    [
        ("edge", "both ways", "eye-to-hand"),
        ("edge", "random", "eye-in-hand"),
        ("ball", "weave", "eye-to-hand"),
        ("disk", "weave", "eye-in-hand"),
    ],
)
def test_pose_and_delay_are_exact_without_noise(kind, pattern, mount):
    """At 150 ms and 150 mm/s, 22 mm: what is left is the spline through the log."""
    exact = {"profile_mm": 0.0}
    scan, truth = driven(
        kind, pattern, noise=exact, mount=mount, delay_ms=-150.0, speed=150.0
    )
    found = pc.calibrate(replace(scan, noise={"accuracy_mm": 0.0}))
    assert_allclose(DEGREES * error_of(found, truth.pose), 0, atol=1e-3)
    assert abs(found.to_json()["delay_ms"] + 150) < 1e-3


SEEDS = range(max(1, int(os.environ.get("PROFILECAL_COVERAGE", "6")) // 6))
LATE = {"delay_ms": 100.0}
BACK = "drive the same sweeps backwards, or stop at eight places"
HARMLESS = "which does not move the sensor"
STATUSES = {BACK: {"unobservable"}, HARMLESS: {"ok"}, "": {"ok", "weak"}}


@pytest.mark.parametrize(
    ("kind", "pattern", "entries", "given_ms", "sentence"),
    [
        ("edge", "one way", LATE | {"speed": 2.0}, None, BACK),
        ("edge", "one way", LATE | {"speed": 150.0}, None, BACK),
        ("plane", "one way", LATE | {"speed": 150.0}, None, BACK),
        ("edge", "one way", LATE | {"stops": 8}, None, ""),
        ("edge", "one way", {"sweeps": 24}, 30.0, ""),
        ("edge", "one way in the base", {"sweeps": 24}, None, HARMLESS),
    ],
)
def test_one_way_leaves_the_delay_open(kind, pattern, entries, given_ms, sentence):
    """Whatever the speed: in the flange it looks like a shift of the sensor, in the
    base like one of the target. A few stops tell it, and one that is given is taken.
    """
    for seed in SEEDS:
        scan, truth = driven(kind, pattern, seed=seed, **entries)
        found = pc.calibrate(replace(scan, delay_ms=given_ms))
        said, printed = " ".join(found.messages), found.to_json()
        assert found.status in STATUSES[sentence]
        assert sentence in said
        assert ("motions leave" in said) == bool(sentence)
        assert (printed["delay_source"] == "given") == bool(given_ms)
        if sentence == HARMLESS:
            assert printed["delay_sd_ms"] > 150
        if sentence != BACK:
            error = error_of(found, truth.pose)
            assert normalised_square(found.solution.covariance, error) < 25
        if not sentence:
            assert abs(printed["delay_ms"] - scan.truth["delay_ms"]) < 3


FIELD = [
    {"drift_ppm": 50.0},
    {"log_hz": 10.0},
    {"dropped_percent": 5.0},
    {"delay_ms": 200.0},
    {"delay_ms": -200.0},
    {"lag_ms": 30.0},
]


@pytest.mark.parametrize("number", range(len(FIELD)))
def test_in_the_field_an_answer_is_right_or_doubted(number):
    """A lag smooths the weave: the residuals tell."""
    noise = USUAL | {"jitter_ms": 0.1}
    for seed in SEEDS:
        kind = ["edge", "ball", "plane"][(number + seed) % 3]
        entries = FIELD[number] | {"sweeps": 12 if kind == "ball" else 24}
        scan, truth = driven(kind, seed=seed, noise=noise, **entries)
        found = pc.calibrate(scan)
        if "lag_ms" in entries:
            assert found.status == "weak"
            assert "the residuals look as if" in " ".join(found.messages)
            continue
        error = error_of(found, truth.pose)
        assert found.status == "ok"
        assert normalised_square(found.solution.covariance, error) < 40
        late = found.to_json()["delay_ms"] - scan.truth["delay_ms"]
        assert abs(late) < 5 * found.to_json()["delay_sd_ms"]
