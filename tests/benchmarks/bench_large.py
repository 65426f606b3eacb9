"""The largest scans that one would record, from files to an answer: within a minute and
2 GB. It takes some minutes, most of them to simulate, and runs where it is asked for.
"""

from bench_volume import within

SCANS = {  # by what they are
    "100,000 edge points": {"kind": "edge", "positions": 10_000},
    "100,000 ball arcs": {"kind": "ball", "positions": 10_000},
    "60,000 edge points, 2 at each pose": {
        "kind": "edge",
        "positions": 3000,
        "repeats": 2,
    },
    "60,000 edge points, 200 at each pose": {
        "kind": "edge",
        "positions": 30,
        "repeats": 200,
    },
    "10,000 raw planes of 640 points": {
        "kind": "plane",
        "positions": 1000,
        "measured": "profiles",
        "scanner": {"points": 640},
    },
}
LIMIT_S, LIMIT_MB = 60, 2000


def rows() -> list[dict]:
    """A row for each scan."""
    return [
        within(LIMIT_S, LIMIT_MB, f"large: {words}", groups=10, **entries)
        for words, entries in SCANS.items()
    ]
