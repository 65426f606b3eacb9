"""What benchmarks share: times of calls, and lines of results/bench.csv.

Once it is imported, the tests' helpers can be, too.
"""

import sys
import time
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1]))


def seconds(function, clock=time.process_time) -> float:
    """How long a call takes."""
    start = clock()
    function()
    return clock() - start


def least(*functions, repeats: int = 5) -> list[float]:
    """Least CPU times of functions that take turns, so that a busy machine slows all
    alike.
    """
    rounds = [[seconds(function) for function in functions] for _ in range(repeats)]
    return [min(taken) for taken in zip(*rounds, strict=True)]


def at_most(most: float, name, ours_s, reference, reference_s, met=True) -> dict:
    """A line of the table: what is to take at most so many times as long as the
    reference, and to have `met` what else is asked of it.
    """
    ratio = ours_s / reference_s
    return {
        "name": name,
        "ours_s": ours_s,
        "reference": reference,
        "reference_s": reference_s,
        "ratio": ratio,
        "target": f"ratio ≤ {most:g}",
        "met": ratio <= most and met,
    }
