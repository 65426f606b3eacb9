"""A log of checks of one mount, a row each, and its picture over time."""

from datetime import datetime
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from profilecal.calibration.check_mount import MountCheck
from profilecal.geometry.noise import FALSE_ALARM, chi2_limit
from profilecal.scan.tables import read_table
from profilecal_pages.figures import RED
from profilecal_tool.report.pictures import panels

AXES = [f"{word}_{axis}" for word in ("shift_mm", "turn_deg") for axis in "xyz"]
COLUMNS = ["date", "scan", "poses", "chi2", "limit", "chance"]
COLUMNS += [name + end for name in AXES for end in ("", "_sd")]


def add_to_log(check: MountCheck, scan: Path, path: Path) -> Path:
    """Add a check to a log, a CSV file; return where its picture is.

    Beside the verdict are the moves of the sensor along and about each of its axes, as
    if it had moved no other way. Raises ScanError for a file that is no such log.
    """
    is_new = not path.exists()
    if not is_new:
        read_table(path, COLUMNS)
    date = datetime.now().isoformat(sep=" ", timespec="seconds")
    moves = np.ravel(check.alone_mm_deg, "F")
    numbers = [check.chi2, check.limit, check.chance, *moves]
    row = pd.DataFrame([[date, scan, len(check.labels), *numbers]], columns=COLUMNS)
    row.to_csv(path, mode="a", header=is_new, index=False, float_format="%.6g")
    return draw_log(path)


def draw_log(path: Path) -> Path:
    """Draw a log over time, with the limits of what chance explains, as a PNG file
    beside it; return where.
    """
    table = pd.read_csv(path, parse_dates=["date"])
    ratio = table["chi2"] / table["limit"]
    title = "Is everything where the calibration left it?"
    figure, (above, below) = panels(2, 1, 2.5, title, sharex=True)
    above.semilogy(table["date"], ratio, "o-", color="0.7")
    above.axhline(1, color=RED)
    above.set_ylabel("χ² over its limit")
    width = np.sqrt(chi2_limit(FALSE_ALARM, 1))
    for name in AXES[:3]:
        sd = width * table[name + "_sd"]
        below.errorbar(table["date"], table[name], sd, capsize=3, label=name[-1])
    below.axhline(0, color="0.7")
    below.set_ylabel("sensor's shift [mm]")
    below.tick_params("x", rotation=30)
    words = "if along this axis alone; bars: what chance exceeds once in 100"
    figure.legend(title=words, ncols=3, loc="outside lower center")
    picture = path.with_suffix(".png")
    figure.savefig(picture, dpi=150)
    plt.close(figure)
    return picture
