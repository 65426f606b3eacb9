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
    try:
        import resource
    except ImportError:  # on Windows and in browsers
        return float("inf")
    of_machine = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    of_process, _ = resource.getrlimit(resource.RLIMIT_AS)
    limits = [of_machine, *limits_of_groups(root)]
    if of_process != resource.RLIM_INFINITY:
        limits.append(of_process)
    return min(limits)


def limits_of_groups(root: Path) -> list[int]:
    """What Linux allows the control group that this process is in, as containers have
    one, and the groups that hold it.
    """
    groups = root / "proc/self/cgroup"
    limits = []
    for line in groups.read_text().splitlines() if groups.exists() else ():
        if line.startswith("0::/"):  # of version 2
            group = root / "sys/fs/cgroup" / line[4:]
            files = [folder / "memory.max" for folder in (group, *group.parents)]
            texts = [file.read_text().strip() for file in files if file.exists()]
            limits += [int(text) for text in texts if text.isdigit()]
    return limits
