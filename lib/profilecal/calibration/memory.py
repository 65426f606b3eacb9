"""How much memory there is, and whether it holds a calibration: what needs more is
ended by the system without a word.
"""

import os
import sys
from collections.abc import Sequence
from pathlib import Path

from profilecal.geometry.observability import brief
from profilecal.scan.tables import ScanError
from profilecal.targets.observations import Observations

# bytes of a profile and of each of its points in the linear model, as measured
A_PROFILE, A_POINT = 9_000, 700


def check_memory(observed: Sequence[Observations]) -> None:
    """Refuse, with ScanError, more profiles than the memory holds."""
    shapes = [entry.points.shape for entry in observed]
    count = sum(P for _, P, _, _ in shapes)
    needed = sum(P * (A_PROFILE + m * A_POINT) for _, P, m, _ in shapes)
    memory = memory_limit()
    if needed > memory:
        raise ScanError(
            f"{count} profiles take {brief(needed / 1e9)} GB of memory, of which there "
            f"are {brief(memory / 1e9)}; {int(count * memory / needed)} would fit: "
            "thin them out"
        )


def memory_limit(root: Path = Path("/")) -> float:
    """The bytes that this process may use: the machine's, or fewer if its container
    allows fewer. Infinite where the system does not tell. `root`: of the file system.
    """
    if sys.platform in ("win32", "emscripten"):
        return float("inf")
    of_machine = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    group = root / "sys/fs/cgroup/memory.max"  # of version 2
    text = group.read_text().strip() if group.exists() else ""
    return min(of_machine, int(text)) if text.isdigit() else of_machine
