"""Scans that are simulated from an answer say whether its uncertainty holds here."""

from dataclasses import replace
from itertools import cycle

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from simulated import ERRING, calibration_of, scan_of

import profilecal as pc
from profilecal.calibration.plausibility import systematic_tests

pytestmark = pytest.mark.usefixtures("read_rightly")
PLANS = {
    "edge": {"groups": 12, "positions": 5, "measured": "profiles"},
    "ball": {"groups": 8, "positions": 3},
    "disk": {"groups": 8, "positions": 4},
    "plane": {"groups": 10, "positions": 2},
}


MOUNTED = [*zip(PLANS, cycle(["eye-in-hand", "eye-to-hand"]), strict=False)]


@pytest.mark.parametrize(("kind", "mount"), MOUNTED)
def test_what_is_as_the_model_has_it_is_believed(kind, mount):
    found = calibration_of(kind, seed=2, noise=ERRING, mount=mount, **PLANS[kind])
    test = pc.self_test(found, 10, seed=5)
    assert test.as_expected
    assert len(test.squares) == 10
    assert "the stated uncertainty can be believed, but" in test.sentence


@pytest.mark.parametrize("kind", ["edge", "ball"])
def test_patterns_of_scans_as_the_model_has_them_are_standard_normal(kind):
    squares = []
    for seed in range(10):
        found = calibration_of(kind, seed=seed, noise=ERRING, groups=8, positions=3)
        tests, _ = systematic_tests(found.solution, {})
        squares.append(np.mean([one.clear**2 for one in tests]))
    assert 0.6 < np.mean(squares) < 1.5  # of some eight independent ones in each


# a plane of 20 poses hardly shows a scale
@pytest.mark.parametrize("kind", ["edge", "plane"])
def test_a_fault_that_the_model_does_not_have_is_named(kind):
    scan = scan_of(kind, seed=2, noise=ERRING, **PLANS[kind])
    scaled = replace(scan, p_base_flange=1.01 * scan.p_base_flange, noise={})
    found = pc.calibrate(scaled)
    test = pc.self_test(found, 10)
    assert "too far apart by" in test.strange[0]
    assert f"do not look like theirs, but as if {test.strange[0]}" in test.sentence


def test_what_rests_on_a_guess_errs_as_the_guess_may():
    plan = {"groups": 6, "positions": 4, "spread_deg": 0.0, "noise": ERRING}
    scan, truth = pc.simulate("edge", seed=2, **plan)
    found = pc.calibrate(scan, truth.pose, (0.5, 0.2))
    squares = pc.self_test(found, 20).squares
    assert 3.5 < squares.mean() < 8.5  # of χ² with 6 degrees of freedom: 6 ± 0.8


def test_a_self_test_is_the_same_again_and_refuses_too_few():
    found = calibration_of("ball", seed=2, noise=ERRING, **PLANS["ball"])
    one, other = (pc.self_test(found, 10, seed=4).squares for _ in range(2))
    assert_array_equal(one, other)
    for count in (9, 10.5):
        sentence = f"count is {count}; expected a whole number, 10 or more"
        with pytest.raises(ValueError, match=sentence):
            pc.self_test(found, count)


def test_regions_that_are_too_small_are_called_so():
    squares, chances = np.full(40, 20.0), {"it is bent": 0.5}
    test = pc.SelfTest(squares, chances)
    assert (test.inside, test.holds, test.as_expected) == (0, False, False)
    assert test.sentence.endswith("the stated uncertainty is too small")
