"""From a scan's files to its answer, ten times as many profiles each time: what it
takes of time and memory grows with them, not with their square. And of scans in motion,
with the delay between both clocks.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

from bench import at_most

import profilecal as pc

CALIBRATE = """
import json, resource, sys, time
import profilecal as pc

start = time.process_time()
status = pc.calibrate(pc.read_scan(sys.argv[1])).status
seconds = time.process_time() - start
kilobytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
print(json.dumps([status, seconds, kilobytes / 1024]))
"""
SIZES = (6, 60, 600, 6000)  # profiles of each of ten orientations
KINDS = {"edge points": "edge", "ball arcs": "ball"}
WEAVING = {"pattern": "weave"}
# in the manner of LVS_ST_CALIB, a public simulator of such scans: 10,024 points
LVS = {"sweeps": 14, "profiles": 716, "speed": 40.0, "delay_ms": -12.0, "turn_deg": 3.0}
LVS_NOISE = {"profile_mm": 0.02, "jitter_ms": 0.25}


def measured(kind: str, **entries) -> tuple[float, float]:
    """CPU seconds and megabytes of a process that reads and calibrates a simulated
    scan: loading Python counts as memory, not as time.
    """
    scan, _ = pc.simulate(kind, seed=1, **entries)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "scan"
        pc.write_scan(scan, folder)
        del scan
        command = [sys.executable, "-c", CALIBRATE, folder]
        done = subprocess.run(command, check=True, stdout=subprocess.PIPE)
    status, seconds, megabytes = json.loads(done.stdout)
    assert status == "ok"
    return seconds, megabytes


def within(limit_s: float, limit_mb: float, words: str, kind: str, **entries) -> dict:
    """A line that is to take at most so much CPU time and memory."""
    seconds, megabytes = measured(kind, **entries)
    name = f"{words}, {megabytes:.0f} of {limit_mb:.0f} MB"
    fits = megabytes <= limit_mb
    return at_most(1, name, seconds, f"{limit_s:g} s", limit_s, fits)


def rows() -> list[dict]:
    """Two of scans in motion; one for each size but the first."""
    lines = [
        within(3, 2000, "motion: 24 sweeps of 60 edge points", "edge", motion=WEAVING),
        within(
            20,
            2000,
            "motion: 14 sweeps of 716 edge points",
            "edge",
            noise=LVS_NOISE,
            motion=WEAVING | LVS,
        ),
    ]
    for words, kind in KINDS.items():
        before = None
        for size in SIZES:
            seconds, megabytes = measured(kind, groups=10, positions=size)
            if before:
                name = f"volume: 10 x {size} {words}, {megabytes:.0f} MB"
                lines.append(at_most(12, name, seconds, "a tenth as many", before))
            before = seconds
    return lines
