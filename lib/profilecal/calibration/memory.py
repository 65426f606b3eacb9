"""How much memory there is, and whether it holds a calibration: what needs more is
ended by the system without a word.
"""

import os
from collections.abc import Sequence

from profilecal.scan.tables import ScanError
from profilecal.targets.observations import Observations

# bytes of a profile and of each of its points in the linear model, as measured
A_PROFILE, A_POINT = 9_000, 700


def check_memory(observed: Sequence[Observations]) -> None:
    """Refuse, with ScanError, more profiles than the memory holds."""
    shapes = [entry.points.shape for entry in observed]
    count = sum(P for _, P, _, _ in shapes)
    needed = sum(P * (A_PROFILE + m * A_POINT) for _, P, m, _ in shapes)
    memory = memory_of_machine()
    if needed > memory:
        raise ScanError(
            f"{count} profiles take {needed / 1e9:.2g} GB of memory, of which there "
            f"are {memory / 1e9:.2g}; {int(count * memory / needed)} would fit: "
            "thin them out"
        )


def memory_of_machine() -> float:
    """The machine's bytes; infinite where the system does not tell."""
    if not hasattr(os, "sysconf"):
        return float("inf")
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
