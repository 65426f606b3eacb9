"""What the report says and draws, in every state that a calibration can end in."""

import re
from dataclasses import replace

import matplotlib.pyplot as plt
import pytest

from profilecal.calibration.calibration import calibrate
from profilecal.geometry.noise import Noise
from profilecal.simulation.spec import Spec, simulate_scan
from profilecal_tool.report import calibration, pictures

EDGE = Spec(
    groups=8,
    positions=6,
    seed=3,
    title="A <bar> & more",
    convention="KUKA angles",
    noise=Noise(0.03),
)
plt.switch_backend("agg")  # which needs no screen
PARTS = ("verdict", "answer", "rejected_poses")


def everything(found) -> str:
    """All words of the report, plain; the figures of the library drawn."""
    figures = [
        figure
        for scan in found.scans
        for figure in pictures.plot_profiles(scan, found.poses_rejected)
    ]
    for figure in [pictures.plot_robot(found), *figures]:
        figure.canvas.draw()
    plt.close("all")
    return "\n".join(getattr(calibration, name)(found).plain for name in PARTS)


def test_weak_scans_say_so_first_and_what_to_add():
    text = everything(calibrate([simulate_scan(replace(EDGE, spread_deg=0.4))]))
    assert text.startswith("Solved, but not well enough to rely on.")
    assert "add" in text.split("\n")[1]


@pytest.mark.parametrize(
    "groups", [{"groups": 1, "positions": 12}, {"groups": 1, "positions": 4}]
)
def test_unobservable_scans_state_no_pose(groups):
    found = calibrate([simulate_scan(replace(EDGE, **groups))])
    text = everything(found)
    assert text.startswith("These measurements cannot determine the scanner's pose.")
    assert "add poses" in text.split("\n")[1]
    assert "translation " not in text


def test_several_scans_and_rejected_poses_are_named():
    edge, ball = (
        simulate_scan(EDGE),
        simulate_scan(replace(EDGE, kind="ball", title="Ball", groups=6, positions=4)),
    )
    values = [v.copy() for v in edge.values]
    values[10] += 5
    values[20] = values[20][:0]
    text = everything(calibrate([replace(edge, values=tuple(values)), ball]))
    assert re.search(
        rf"Pose A <bar> & more: {edge.labels[10]}: \d+\.\d times the noise", text
    )
    assert f"from pose {edge.labels[20]}" in text
    assert "Ball: ball, radius 25 mm" in text


def test_a_scanner_that_stands_still_is_in_the_base_frame():
    text = everything(
        calibrate(
            [
                simulate_scan(
                    replace(EDGE, mount="eye-to-hand", convention="rotation vector")
                )
            ]
        )
    )
    assert "of the sensor's origin in the base frame" in text
    assert "\np[" in text  # the line to paste
    assert "the flange's" not in text


@pytest.mark.parametrize("kind", ["edge", "disk", "ball", "plane"])
def test_every_profile_is_drawn(kind):
    scan = simulate_scan(
        replace(EDGE, kind=kind, measured="profiles", groups=8, positions=3)
    )
    empty = replace(scan, values=(scan.values[0][:0], *scan.values[1:]))
    figures = pictures.plot_profiles(empty)
    shown = [
        text.get_text().split()[0]
        for figure in figures
        for text in figure.axes[0].texts
    ]
    assert [label for label in shown if label in scan.labels] == list(scan.labels)
    assert figures[0].axes[0].texts[0].get_text() == f"{scan.labels[0]} not found"
    plt.close("all")
