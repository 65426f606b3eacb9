"""Models of every target at one rough guess."""

from functools import cache

from numpy.random import default_rng

from profilecal_tool.plan.knowledge import model_of_spec
from profilecal_tool.plan.scan_model import ScanModel
from profilecal_tool.plan.specification import read_specification

GUESS = {"mount": [60, -40, 110, 170, 10, 30], "target": [900, 50, 300]}
# the scanner stands in the base, the target is on the flange
GUESS_TO_HAND = {"mount": [900, 0, 700, 180, 0, 0], "target": [20, 0, 150]}
KINDS = ("edge", "disk", "ball", "plane", "rod")


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
