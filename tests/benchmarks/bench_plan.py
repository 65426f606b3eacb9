"""Designing a plan of 30 poses, for each target."""

import tempfile
from pathlib import Path

from bench import at_most, seconds
from planned import GUESS, KINDS

from profilecal.scan.toml import toml_text
from profilecal_tool.plan.task import read_task

LIMIT_S = 10.0


def planning(kind: str, folder: Path) -> float:
    """CPU seconds from a specification to its plan."""
    spec = folder / f"{kind}.toml"
    entries = {"kind": kind, "seed": 6, "measured": "profiles", "guess": GUESS}
    spec.write_text(toml_text(entries), encoding="utf-8")
    return seconds(lambda: read_task(spec, poses=30).plan())


def rows() -> list[dict]:
    """A row a target."""
    with tempfile.TemporaryDirectory() as name:
        times = {kind: planning(kind, Path(name)) for kind in KINDS}
    return [
        at_most(1, f"plan: 30 poses over a {kind}", ours, "ten seconds", LIMIT_S)
        for kind, ours in times.items()
    ]
