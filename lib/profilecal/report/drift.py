"""The log of drift checks: a line for each, and its picture."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from profilecal.report.figures import BLUE, RED, use_style
from profilecal.scan.files import is_file, naming, whole
from profilecal.scan.scan import ScanError


def add_to_log(path: Path, row: dict) -> Path:
    """Add a line to a CSV file, which may be new, and draw the file beside it. Returns the picture's path.

    Raises ScanError for a file that is no such log; it stays as it is.
    """
    frame = pd.DataFrame([row])
    with naming(path):
        if is_file(path):
            known = pd.read_csv(path)
            if list(known.columns) != list(frame.columns):
                raise ScanError(f"{path}: not a log of drift checks; name another file")
            frame = pd.concat([known, frame], ignore_index=True)
        with whole(path) as partial:
            frame.to_csv(partial, index=False)
    picture = path.with_suffix(".png")
    draw(frame, picture)
    return picture


def draw(frame: pd.DataFrame, picture: Path) -> None:
    """How far off the sensor was at each check, with twice the standard deviation; red where it had moved."""
    use_style()
    time = pd.to_datetime(frame["time"])
    figure, panels = plt.subplots(2, 1, figsize=(8, 5), sharex=True)
    parts = (["x_mm", "y_mm", "z_mm"], ["rx_deg", "ry_deg", "rz_deg"])
    for axes, columns, unit in zip(panels, parts, ("mm", "°"), strict=True):
        off = np.linalg.norm(frame[columns], axis=1)
        band = 2 * np.linalg.norm(frame[[f"sd_{name}" for name in columns]], axis=1)
        axes.fill_between(time, 0, band, color="0.9", label="within two standard deviations of none")
        axes.plot(time, off, "o-", color=BLUE, label="found")
        moved = frame["moved"].astype(bool)
        axes.plot(time[moved], off[moved], "o", color=RED, label="moved")
        axes.set(ylabel=f"off by [{unit}]", ylim=(0, None))
    panels[0].set_title(f"The sensor has moved in {int(moved.sum())} of {len(frame)} checks", loc="left")
    panels[0].legend(ncols=3)
    figure.autofmt_xdate()
    figure.savefig(picture, dpi=150)
    plt.close(figure)
