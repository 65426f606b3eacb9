"""What the report says and draws, in every state that a calibration can end in."""

import re
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy.stats import binom
from simulated import scan_of, with_values

from profilecal.calibration.calibrate import calibrate
from profilecal_tool.report import calibration, pictures

PLAN = {"seed": 1, "groups": 8, "positions": 6, "noise": {"profile_mm": 0.03}}
FINE = {"measured": "profiles", "scanner": {"points": 300}}
plt.switch_backend("agg")  # which needs no screen


def report_on(*scans) -> str:
    """All words of the report on scans, plain; its figures are drawn too."""
    found = calibrate(scans)
    figures = [pictures.plot_robot(found)]
    if found.solution_or_none:
        draw = [pictures.plot_residuals, pictures.plot_patterns]
        draw += [pictures.plot_points] * found.is_known
        figures += [one(found) for one in draw]
    for scan in scans:
        figures += pictures.plot_profiles(scan, found.poses_rejected)
    for figure in figures:
        figure.canvas.draw()
        for axes in figure.axes:
            boxes = [text.get_window_extent() for text in axes.texts]
            assert all(axes.bbox.count_contains(one.corners()) == 4 for one in boxes)
    plt.close("all")
    parts = (calibration.verdict, calibration.answer, calibration.rejected_poses)
    return "\n".join(part(found).plain for part in parts)


@pytest.mark.parametrize(
    ("plan", "first"),
    [
        ({"spread_deg": 0.4}, "Solved, but not well enough to rely on."),
        ({"groups": 1, "positions": 4}, "These measurements cannot determine the"),
        ({"groups": 1, "positions": 12}, "These measurements cannot determine the"),
    ],
)
def test_scans_say_first_that_they_are_not_enough_and_what_to_add(plan, first):
    text = report_on(scan_of("edge", **PLAN | plan))
    assert text.startswith(first)
    assert "add" in text.splitlines()[1]
    assert ("translation " in text) == ("spread_deg" in plan)


def test_several_scans_and_rejected_poses_are_named():
    edge = scan_of("edge", title=r"A <bar> & $\more$", **PLAN)
    edge = replace(edge, labels=[rf"$\{label}$" for label in edge.labels])
    wrong = with_values(edge, lambda rows: rows + 5, [10])
    wrong = with_values(wrong, lambda rows: rows[:0], [20])
    text = report_on(wrong, scan_of("ball", title="Ball", **PLAN))
    first = re.search(r"middle of what was seen is known to (\S+) mm", text)[1]
    below = re.search(r"points +known to (\S+) mm in the middle", text)[1]
    assert first == below
    rejected = re.escape(f"Pose {edge.title}: {edge.labels[10]}: ")
    assert re.search(rf"{rejected}\d+\.\d times the noise; chance explains \d", text)
    assert f"1 pose left out, no point: {edge.labels[20]}" in text
    assert "Ball: ball, radius 25 mm" in text


def test_a_scanner_that_stands_still_is_in_the_base_frame():
    about = {"mount": "eye-to-hand", "convention": "rotation vector"}
    text = report_on(scan_of("edge", **PLAN, **about))
    assert "of the sensor's origin in the base frame" in text
    assert "\np[" in text  # the line to paste
    assert "the flange's" not in text


@pytest.mark.parametrize("kind", ["edge", "disk", "ball", "plane"])
def test_every_profile_is_drawn(kind):
    scan = scan_of(kind, measured="profiles", groups=8, positions=3)
    first, *others = scan.values
    shown = []
    for figure in pictures.plot_profiles(replace(scan, values=(first[:0], *others))):
        shown += [axes.get_title() for axes in figure.axes if axes.axison]
    plt.close("all")
    assert [text.split()[0] for text in shown] == list(scan.labels)
    assert shown[0] == f"{scan.labels[0]} not found"

    few = [*pictures.plot_profiles(scan, most=10)]
    assert sum(axes.axison for figure in few for axes in figure.axes) == 8
    assert "8 features found" in few[0].get_suptitle()
    assert "(one in 3 is drawn)" in few[0].get_suptitle()
    plt.close("all")


def test_means_leave_the_band_of_chance_over_what_a_fault_depends_on():
    """A drift, in order; of means without a fault one in twenty does, although the
    profiles of a sweep share an error of the robot.
    """
    scan = scan_of("plane", seed=3, groups=10, **FINE)
    drift = np.linspace(0, [0, 0, 1], len(scan.p_base_flange))
    drifted = replace(scan, p_base_flange=scan.p_base_flange + drift)
    swept = scan_of("edge", motion={}, noise={"group_position_mm": 0.05})
    outside = []
    for one in (scan, swept, drifted):
        _, places = pictures.panels(1, 4, 1.4)
        pictures.draw_patterns(places, calibrate([one]))
        outside.append([])
        for axes in places:
            x, mean = axes.lines[-1].get_data()
            ends = axes.collections[0].get_paths()[0].vertices
            half = [np.abs(ends[ends[:, 0] == at, 1]).max() for at in x]
            outside[-1].append(int(np.sum(np.abs(mean) > half)))
    plt.close("all")
    assert max(map(sum, outside[:2])) <= binom.ppf(0.995, 32, 0.05)
    assert outside[2][2] >= 4
