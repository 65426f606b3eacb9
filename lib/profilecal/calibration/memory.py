"""How much memory there is, and whether it holds a calibration: what needs more is
ended by the system without a word.
"""

import os
from collections.abc import Sequence
from pathlib import Path

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
            f"{count} profiles take {needed / 1e9:.2g} GB of memory, of which there "
            f"are {memory / 1e9:.2g}; {int(count * memory / needed)} would fit: "
            "thin them out"
        )


def memory_limit(root: Path = Path("/")) -> float:
    """The bytes that this process may use: the machine's, or fewer if a container or
    its shell allow fewer. Infinite where the system does not tell. `root`: of the file
    system.
    """
    limits = [float("inf"), *limits_of_groups(root)]
    if hasattr(os, "sysconf"):
        limits.append(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    try:
        import resource
    except ImportError:  # not on Windows
        return min(limits)
    of_process, _ = resource.getrlimit(resource.RLIMIT_AS)
    if of_process != resource.RLIM_INFINITY:
        limits.append(of_process)
    return min(limits)


def limits_of_groups(root: Path) -> list[int]:
    """What Linux allows the control groups that this process is in, as containers have
    them, and the groups that hold these: version 2 in the first file, 1 in the second.
    """
    groups = root / "proc/self/cgroup"
    files = {
        "": ("sys/fs/cgroup", "memory.max"),
        "memory": ("sys/fs/cgroup/memory", "memory.limit_in_bytes"),
    }
    limits = []
    for line in groups.read_text().splitlines() if groups.exists() else ():
        _, controllers, group = line.split(":", 2)
        for controller in files.keys() & controllers.split(","):
            place, name = files[controller]
            parts = Path(group).parts[1:]
            for depth in range(len(parts) + 1):
                file = root.joinpath(place, *parts[:depth], name)
                text = file.read_text().strip() if file.exists() else "max"
                if text.isdigit():
                    limits.append(int(text))
    return limits
