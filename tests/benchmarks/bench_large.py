"""The largest scans that one would record, from files to an answer: within a minute and
2 GB. It takes some minutes, most of them to simulate, and runs where it is asked for.
"""

from bench import row
from bench_volume import measured

SCANS = {  # by what they are
    "100,000 edge points": ("edge", {"positions": 10_000}),
    "100,000 ball arcs": ("ball", {"positions": 10_000}),
    "60,000 edge points, 2 at each pose": ("edge", {"positions": 3000, "repeats": 2}),
    "60,000 edge points, 200 at each pose": ("edge", {"positions": 30, "repeats": 200}),
    "10,000 raw planes of 640 points": (
        "plane",
        {"positions": 1000, "measured": "profiles", "scanner": {"points": 640}},
    ),
}
LIMIT_S, LIMIT_MB = 60.0, 2000.0


def rows() -> list[dict]:
    """A row for each scan."""
    lines = []
    for words, (kind, entries) in SCANS.items():
        seconds, megabytes = measured(kind, **entries)
        name = f"large: {words}, {megabytes:.0f} MB"
        met = seconds <= LIMIT_S and megabytes <= LIMIT_MB
        target = f"within it and {LIMIT_MB:.0f} MB"
        ratio = seconds / LIMIT_S
        lines.append(row(name, seconds, "a minute", LIMIT_S, ratio, target, met))
    return lines
