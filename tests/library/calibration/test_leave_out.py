"""Cross-validation: predictions from the other orientations are as far off as stated,
and a bad orientation shows.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from profilecal.calibration.calibration import calibrate
from profilecal.calibration.leave_out import leave_out
from profilecal.geometry.checks import UnobservableError
from profilecal.geometry.noise import Noise, normalised_square
from profilecal.simulation.spec import Spec, simulate_scan
from profilecal.targets import TARGETS
from profilecal_tool.words import left_out_sentences


@pytest.mark.parametrize(
    ("kind", "robot"),
    [
        *((kind, (0.03, 0.05)) for kind in ("edge", "disk", "ball", "plane", "point")),
        ("plane", (0, 0)),
    ],
)
def test_predictions_are_as_far_off_as_expected(kind, robot):
    noise = Noise(profile_mm=0.05, position_mm=robot[0], group_position_mm=robot[1])
    positions = min(TARGETS[kind].positions, 10)
    spec = Spec(kind, noise=noise, groups=8, positions=positions)
    squares, doubted, count = 0.0, 0, 0
    for seed in range(3):
        left = leave_out(calibrate(simulate_scan(replace(spec, seed=seed))))
        squares += np.sum(left.rms_mm**2 / left.expected_mm**2)
        doubted += left.doubted.sum()
        count += len(left.rms_mm)
    assert count >= 20
    # the residuals of an orientation are few and correlated: at most as uncertain as
    # one normal number each
    assert squares / count == pytest.approx(1, abs=norm.isf(1e-3) * np.sqrt(2 / count))
    assert doubted <= 1


def test_an_orientation_that_does_not_fit_is_named():
    scan = simulate_scan(Spec("edge", seed=2, groups=8, noise=Noise(profile_mm=0.05)))
    values = list(scan.values)
    for k in range(30, 40):
        values[k] = values[k] + [0.3, 0.0]  # too little for any pose to be rejected
    found = calibrate([replace(scan, values=tuple(values))])
    left = leave_out(found)
    assert np.flatnonzero(left.doubted).tolist() == [3]
    said = " ".join(left_out_sentences(left))
    assert "what poses g4p1 to g4p10 saw does not fit the other orientations" in said


def test_an_orientation_that_is_needed_is_named():
    scan = simulate_scan(Spec("ball", seed=2, groups=3, positions=4, spread_deg=40))
    left = leave_out(calibrate([scan]))
    needed = np.isnan(left.rms_mm)
    summaries = 0 if needed.all() else 1
    sentences = summaries + left.doubted.sum() + needed.sum()
    assert len(left_out_sentences(left)) == sentences


def test_without_an_answer_nothing_can_be_cross_validated():
    found = calibrate([simulate_scan(Spec("edge", spread_deg=0.0))])
    with pytest.raises(UnobservableError, match="add poses tilted by 15° or more"):
        leave_out(found)


@pytest.mark.parametrize("kind", ["edge", "ball"])
def test_the_answer_moves_by_what_one_orientation_of_many_knows(kind):
    """Without one of G orientations that know alike, δ's covariance grows by 1 / (G -
    1); the answer moves by that.
    """
    found = calibrate([simulate_scan(Spec(kind, seed=4, groups=12, positions=5))])
    squares = normalised_square(found.covariance_mm_deg, leave_out(found).moved_mm_deg)
    assert squares.mean() < 6 / 11 * 2
