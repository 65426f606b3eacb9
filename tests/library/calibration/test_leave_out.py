"""Cross-validation: predictions from the other orientations are as far off as stated,
and a bad orientation shows.
"""

import numpy as np
import pytest
from scipy.stats import norm
from simulated import SCANNER, calibration_of, scan_of, with_values

import profilecal as pc
from profilecal.geometry.noise import normalised_square
from profilecal.targets import TARGETS

ERRING = {"position_mm": 0.03, "group_position_mm": 0.05}
CASES = [(kind, ERRING) for kind in ("edge", "disk", "ball", "plane", "point")]


@pytest.mark.parametrize(("kind", "noise"), [*CASES, ("plane", {})])
def test_predictions_are_as_far_off_as_expected(kind, noise):
    positions = min(TARGETS[kind].positions, 10)
    plan = {"groups": 8, "positions": positions, "noise": noise, "scanner": SCANNER}
    left_out = [
        pc.leave_out(calibration_of(kind, seed=seed, **plan)) for seed in range(3)
    ]
    squares = np.concatenate(
        [left.rms_mm**2 / left.expected_mm**2 for left in left_out]
    )
    count = len(squares)
    assert count >= 20
    # the residuals of an orientation are few and correlated: at most as uncertain as
    # one normal number each
    bound = norm.isf(1e-3) * np.sqrt(2 / count)
    assert squares.mean() == pytest.approx(1, abs=bound)
    assert sum(left.doubted.sum() for left in left_out) <= 1


@pytest.mark.parametrize("parts", [100, 4])
def test_an_orientation_that_does_not_fit_is_doubted(monkeypatch, parts):
    monkeypatch.setattr("profilecal.calibration.leave_out.PARTS", parts)
    scan = scan_of("edge", seed=2, groups=8)
    shift = np.array([0.3, 0.0])  # too little for any pose to be rejected
    wrong = with_values(scan, range(30, 40), lambda rows: rows + shift)
    left = pc.leave_out(pc.calibrate(wrong))
    assert np.flatnonzero(left.doubted).tolist() == [3]
    moved = {*map(tuple, left.moved_mm_deg)}
    assert len(moved) == min(parts, 8)


def test_without_an_answer_nothing_can_be_cross_validated():
    found = calibration_of("edge", spread_deg=0.0)
    sentence = "add poses tilted by 15° or more"
    with pytest.raises(pc.UnobservableError, match=sentence):
        pc.leave_out(found)


@pytest.mark.parametrize("kind", ["edge", "ball"])
def test_the_answer_moves_by_what_one_orientation_of_many_knows(kind):
    """Without one of G orientations that know alike, δ's covariance grows by 1 / (G -
    1); the answer moves by that.
    """
    found = calibration_of(kind, seed=4, groups=12, positions=5)
    moved = pc.leave_out(found).moved_mm_deg
    squares = normalised_square(found.covariance_mm_deg, moved)
    assert squares.mean() < 6 / 11 * 2
