"""Models of every target at one rough guess; specifications as files."""

import re
from functools import cache

import numpy as np
from numpy.random import default_rng

from profilecal_tool.plan.knowledge import model_of_spec
from profilecal_tool.plan.scan_model import ScanModel
from profilecal_tool.plan.specification import read_specification

GUESS = {"mount": [60, -40, 110, 170, 10, 30], "target": [900, 50, 300]}
# the scanner stands in the base, the target is on the flange
GUESS_TO_HAND = {"mount": [900, 0, 700, 180, 0, 0], "target": [20, 0, 150]}
KINDS = ("edge", "disk", "ball", "plane", "rod")
SPEC = """
kind = "edge"
seed = 2
[guess]
mount = [60, -40, 110, 170, 10, 30]
target = [900, 50, 300]
[noise]
profile_mm = 0.05
position_mm = 0.05
orientation_deg = 0.02
[plan]
candidates = 500
poses = 8
"""
TO_HAND = (
    ("mount = [60, -40, 110, 170, 10, 30]", "mount = [900, 0, 700, 180, 0, 0]"),
    ("target = [900, 50, 300]", "target = [20, 0, 150]"),
    ("seed = 2", 'seed = 2\nmount = "eye-to-hand"'),
)


def spec_in(folder, *changes):
    """A specification in a folder, with changes."""
    text = SPEC
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / "spec.toml").write_text(text)
    return folder / "spec.toml"


def worst(output):
    """The predicted worst standard deviations, mm and degrees."""
    numbers = re.search(r"worst +([\d.]+) mm and ([\d.]+)°", output)
    return np.array(numbers.groups(), dtype=float)


@cache
def model_for(kind: str, measured: str = "", mount: str = "eye-in-hand") -> ScanModel:
    """A model with robot errors as usual.

    It has raw profiles where there are any and nothing else is asked for.
    """
    entries = {
        "kind": kind,
        "guess": GUESS_TO_HAND if mount == "eye-to-hand" else GUESS,
        "measured": measured or ("points" if kind == "point" else "profiles"),
        "mount": mount,
    }
    spec = read_specification(entries, "specification")
    return model_of_spec(spec, {}, default_rng(1))
