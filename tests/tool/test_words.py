"""Answers in words."""

from dataclasses import replace

import pytest

from profilecal.calibration.calibration import calibrate
from profilecal.geometry.noise import Noise
from profilecal.simulation.spec import Spec, simulate_scan
from profilecal_tool.words import calibration_text, robot_errors

FIRST = ["status", "translation", "rotation", "PASTE", "uncertainty", "poses"]


@pytest.mark.parametrize("is_stated", [True, False])
def test_the_answer_says_one_uncertainty_and_chi2_only_where_the_noise_is_stated(
    is_stated,
):
    scan = simulate_scan(Spec(measured="points"))
    if not is_stated:
        scan = replace(scan, noise={})
    text = calibration_text(calibrate([scan]), "PASTE")
    names = [line.split()[0] for line in text.splitlines()]
    assert names[:6] == FIRST
    assert text.count("standard deviation") == 1
    assert text.count("robot errors   ") == 1
    assert ("χ²/dof" in text) == is_stated


def test_robot_errors_are_told_apart_by_where_they_arise():
    noise = Noise(
        profile_mm=0.1,
        position_mm=0.123,
        group_position_mm=0.04,
        group_orientation_deg=0.02,
    )
    assert robot_errors(noise) == (
        "at each pose 0.12 mm and 0°, "
        "shared by the poses of an orientation 0.04 mm and 0.02°"
    )
    assert robot_errors(Noise(profile_mm=0.1)) == "none that the residuals show"
