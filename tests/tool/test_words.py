"""Answers in words."""

import re
from dataclasses import replace

import pytest
from simulated import calibration_of

import profilecal as pc
from profilecal.geometry.noise import Noise
from profilecal_tool.words import (
    calibration_lines,
    delay_words,
    robot_errors,
)


@pytest.mark.parametrize("is_stated", [True, False])
def test_the_answer_has_chi2_only_where_the_noise_is_stated(is_stated):
    scan, _ = pc.simulate(measured="points")
    if not is_stated:
        scan = replace(scan, noise={})
    lines = dict(calibration_lines(pc.calibrate(scan)))
    assert ("χ²/dof" in lines["residuals"]) == is_stated


EACH = "at each pose 0.12 mm and 0°"
SHARED = "shared by the poses of an orientation"
ERRORS = {  # by what is said of them
    f"{EACH}, {SHARED} 0.04 mm and 0.02°, of the times 0.25 ms": {"jitter_ms": 0.25},
    EACH: {"group_position_mm": 0.0, "group_orientation_deg": 0.0},
}


@pytest.mark.parametrize("said", ERRORS)
def test_robot_errors_are_told_apart_by_where_they_arise(said):
    found = {"position_mm": 0.123, "group_position_mm": 0.04}
    found |= {"group_orientation_deg": 0.02} | ERRORS[said]
    assert robot_errors(Noise(0.1, **found)) == said
    assert robot_errors(Noise(0.1)) == "none that residuals show"
    smooth = Noise(0.1, accuracy_mm=0.3)
    assert robot_errors(smooth) == "no others that residuals show"


@pytest.mark.parametrize(
    ("delay_ms", "sd_ms", "words"),
    [
        (30.12, 0.104, "30.1 ± 0.1 ms (the scanner's clock is behind)"),
        (-12.0091, 0.0042, "-12.009 ± 0.004 ms (the scanner's clock is ahead)"),
        (151.8, 3.4, "152 ± 3 ms (the scanner's clock is behind)"),
        (0.4, 201.2, "open (± 200 ms)"),
    ],
)
def test_a_delay_is_said_to_its_first_digit_in_doubt(delay_ms, sd_ms, words):
    assert delay_words(delay_ms, sd_ms) == words


def test_the_answer_of_sweeps_has_their_delay():
    motion = {"sweeps": 8, "profiles": 20, "delay_ms": -40.0}
    found = calibration_of("edge", motion=motion)
    delay = dict(calibration_lines(found))["delay"]
    assert re.fullmatch(r"-(39|40)\.\d+ ± 0\.\d+ ms \(.* is ahead\)", delay)
