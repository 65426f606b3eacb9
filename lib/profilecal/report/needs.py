"""What a method needs: errors that more and fewer data leave, at two noise levels."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from profilecal.report.figures import ORANGE, RED

UNITS = {"rotation": "°", "translation": "mm"}


def plot_needs(needs: pd.DataFrame, errors, asked: dict[str, str], sought) -> plt.Figure:
    """Pairs of dots, the errors at the larger (filled) and the smaller noise (open), from the top.

    `needs`: columns method, data, and for rotation and translation whether they are determined. `errors`
    (2, rows, 2): noise levels, rows, rotation and translation. `asked`: the data that a paper asks for, by method.
    `sought` (2,): the size of what is sought, at which dots stop.
    """
    place = np.arange(len(needs)) + 0.8 * (needs["method"] != needs["method"].shift()).cumsum()
    figure, axes = plt.subplots(1, 2, figsize=(10, 0.27 * len(needs) + 1.6), sharey=True)
    for ax, (name, unit), (coarse, fine), limit in zip(
        axes, UNITS.items(), np.moveaxis(errors, 2, 0), sought, strict=True
    ):
        ends = np.minimum(np.nan_to_num([coarse, fine], nan=np.inf, posinf=np.inf), limit)
        for yes, colour, label in ((True, ORANGE, "determined"), (False, "0.6", "not determined")):
            at = (needs[name] == yes).to_numpy()
            ax.plot(ends[:, at], np.tile(place[at], (2, 1)), color=colour)
            ax.plot(ends[0, at], place[at], "o", color=colour, ms=8, label=f"{label}: error at the noise …")
            ax.plot(ends[1, at], place[at], "o", color=colour, mfc="white", ms=5, label="… and at the smaller one")
        ax.set(xscale="log", xlabel=f"median error of the {name} [{unit}]")
    for row, at in zip(needs.itertuples(), place, strict=True):
        if asked.get(row.method) == row.data:
            axes[1].plot(1.03, at, "<", color=RED, ms=8, clip_on=False, transform=axes[1].get_yaxis_transform())
    axes[1].plot([], [], "<", color=RED, label="what the paper asks for")
    axes[0].set_yticks(place, needs["method"] + ": " + needs["data"])
    axes[0].invert_yaxis()
    figure.suptitle("Enough data: the error shrinks with the noise. Too few: it stays")
    figure.legend(*axes[1].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure
