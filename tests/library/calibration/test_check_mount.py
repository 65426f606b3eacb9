"""One to three poses against what a calibration predicts of them."""

from dataclasses import replace
from itertools import cycle

import numpy as np
import pytest
from simulated import ERRING, few, moved, scan_of, with_values

import profilecal as pc

pytestmark = pytest.mark.usefixtures("read_rightly")
PLANS = {  # raw profiles where a target leaves them
    "edge": {"groups": 12, "positions": 3},
    "ball": {"groups": 10, "positions": 3, "measured": "profiles"},
    "plane": {"groups": 15, "positions": 2},
    "disk": {"groups": 10, "positions": 4, "measured": "profiles"},
    "point": {"groups": 12, "positions": 3},
    "rod": {"groups": 15, "positions": 2},
}


def scans(kind, count, seed=1, **entries):
    """Of one scanner and target; what is stated is the scanner's noise alone."""
    plan = {"noise": ERRING} | PLANS[kind] | entries
    for number in range(1, count + 1):
        scan = scan_of(kind, seed=seed, scan=number, **plan)
        yield replace(scan, noise={"profile_mm": 0.05} if kind == "edge" else {})


def moved_sensor(scan, by):
    return with_values(scan, lambda rows: rows + by)


SWEEPS = {"motion": {"sweeps": 12, "profiles": 20}}
MOUNTED = [*zip(PLANS, cycle(["eye-to-hand", "eye-in-hand"]), strict=False)]


@pytest.mark.parametrize(("kind", "mount"), MOUNTED)
def test_poses_are_predicted_and_a_moved_sensor_is_seen(kind, mount):
    first, *others = scans(kind, 5, mount=mount)
    found = pc.calibrate(first)
    errors = found.answer.joint.robot_errors
    assert errors["accuracy_deg"] == pytest.approx(0.1 * errors["accuracy_mm"])
    checks = [pc.check_mount(found, few(scan, [0, 9, 20])) for scan in others]
    mean = np.mean([check.chi2 / check.count for check in checks])
    assert 0.3 < mean < 2
    assert np.mean([check.as_expected for check in checks]) > 0.7
    by = [0, 3 * checks[0].seen_mm_deg[2]] if kind != "point" else [1.5, 0]
    shifted = pc.check_mount(found, moved_sensor(few(others[0], [0, 9, 20]), by))
    assert not shifted.as_expected


TOLD = dict.fromkeys(["edge", "ball", "disk"], ("target",))
TOLD["plane"] = ("sensor", "target")  # along its normal, which all poses look along


@pytest.mark.parametrize(("kind", "suspects"), TOLD.items())
def test_what_moved_is_told_where_poses_are_enough_and_not_from_one(kind, suspects):
    first, again = scans(kind, 2, seed=2)
    found = pc.calibrate(first)
    one, many = [4], range(0, len(again.labels), 3)
    at_many = repr(pc.check_mount(found, few(again, many)))
    assert at_many.endswith(f"poses={len(many)})")
    verdicts = {}
    for name, change, by in [
        ("sensor", moved_sensor, [2.0, 8.0]),
        ("target", moved, [8.0, 3.0, 2.0]),  # met elsewhere
    ]:
        changed = change(again, np.array(by))
        alone = pc.check_mount(found, few(changed, one))
        assert not alone.as_expected
        assert alone.suspects == ("sensor", "target")
        assert repr(alone).endswith("poses=1, suspects=('sensor', 'target'))")
        verdicts[name] = pc.check_mount(found, few(changed, many)).suspects
    assert verdicts == {"sensor": ("sensor",), "target": suspects}


def test_the_shift_that_is_said_to_show_shows_nine_times_of_ten():
    first, *others = scans("ball", 21, seed=4, measured="arcs")
    found = pc.calibrate(first)
    seen = 0
    for scan in others:
        some = few(scan, [2, 15, 27])
        shift = pc.check_mount(found, some).seen_mm_deg[0]
        seen += not pc.check_mount(found, moved_sensor(some, [shift, 0, 0])).as_expected
    assert 14 <= seen <= 20  # 18 ± 1.3 of 20, and the law of the errors is estimated


def test_what_an_answer_from_few_poses_leaves_open_is_allowed_for():
    """χ² over its count has the mean 1; were the answer exact, it would be 5."""
    ratios = []
    for seed in range(1, 5):
        (first,) = scans("plane", 1, seed=seed, groups=8, positions=1)
        _, later = scans("plane", 2, seed=seed)
        check = pc.check_mount(pc.calibrate(first), few(later, [0, 9, 20]))
        ratios.append(check.chi2 / check.count)
    assert 0.3 < np.mean(ratios) < 2


@pytest.mark.parametrize(("calibrated", "shift"), [(SWEEPS, 0.5), ({}, 2.0)])
def test_sweeps_are_predicted_if_their_delay_is_stated(calibrated, shift):
    """It may be another one than that of the calibration; jitter that it hardly knows
    hides no move.
    """
    noise = {"profile_mm": 0.05, "group_position_mm": 0.05, "jitter_ms": 0.1}
    found = pc.calibrate(scan_of("ball", seed=1, noise=noise, **calibrated))
    swept, still = (
        scan_of("ball", seed=1, scan=2, noise=noise, **later) for later in (SWEEPS, {})
    )
    delay_ms = swept.truth["delay_ms"]
    for scan in (replace(swept, delay_ms=delay_ms), still):
        assert pc.check_mount(found, scan).as_expected
        shifted = moved_sensor(scan, [shift, 0, 0])
        assert not pc.check_mount(found, shifted).as_expected
    with pytest.raises(pc.ScanError, match=r"expected \[motion\] delay_ms in its"):
        pc.check_mount(found, swept)


def test_points_are_judged_by_the_noise_that_they_state():
    """Fitted corners, of which the calibration is, err by far less."""
    plan = {"groups": 10, "positions": 3, "measured": "profiles"}
    found = pc.calibrate(scan_of("edge", seed=1, **plan))
    later = scan_of("edge", seed=1, scan=2)
    assert found.noise_mm < later.noise["profile_mm"] / 2
    assert pc.check_mount(found, later).as_expected
    corners = scan_of("edge", seed=1, scan=2, **plan)
    assert corners.noise  # of points, not of what is fitted to them
    checks = [
        pc.check_mount(found, replace(corners, noise=own))
        for own in (corners.noise, {})
    ]
    assert checks[0].chi2 == checks[1].chi2


def test_answers_without_what_it_takes_are_refused():
    first, again = scans("plane", 2)
    found, some = pc.calibrate(first), few(again, [1, 8])
    assert pc.check_mount(found.answer, some).chi2 == pc.check_mount(found, some).chi2
    old = replace(found.answer, joint=None)
    with pytest.raises(pc.ScanError, match="holds no prediction of other poses"):
        pc.check_mount(old, some)
    (edge,) = scans("edge", 1)
    with pytest.raises(
        pc.ScanError, match=r"its edge is none of the calibration's targets \(plane\)"
    ):
        pc.check_mount(found, edge)
    ball, larger = scan_of("ball", seed=1), scan_of("ball", seed=1, scan=2, radius=30)
    with pytest.raises(
        pc.ScanError,
        match=r"its ball, radius 30 mm is none of .* \(ball, radius 25 mm\)",
    ):
        pc.check_mount(pc.calibrate(ball), larger)
