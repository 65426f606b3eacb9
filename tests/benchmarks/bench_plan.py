"""Designing a plan of 30 poses, for each target."""

import tempfile
from pathlib import Path

from bench import at_most, seconds
from planned import GUESS, KINDS

from profilecal.scan.toml import toml_text
from profilecal_tool.plan.task import read_task

LIMIT_S = 10.0


def rows() -> list[dict]:
    """A row a target: CPU seconds from a specification to its plan."""
    lines = []
    with tempfile.TemporaryDirectory() as place:
        spec = Path(place) / "spec.toml"
        for kind in KINDS:
            entries = {"kind": kind, "seed": 6, "measured": "profiles", "guess": GUESS}
            spec.write_text(toml_text(entries), encoding="utf-8")
            ours = seconds(lambda: read_task(spec, poses=30).plan())
            name = f"plan: 30 poses over a {kind}"
            lines.append(at_most(1, name, ours, "ten seconds", LIMIT_S))
    return lines
