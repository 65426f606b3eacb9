"""What a method needs: bars of the errors that more and fewer data leave."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from profilecal.report.figures import ORANGE, RED


def plot_needs(needs: pd.DataFrame, asked: dict[str, str], limit: float) -> plt.Figure:
    """Bars of the column "error over noise" of a table with columns method, data and suffices, from the top.

    `asked`: the data that a paper asks for, by method. Bars end at `limit`, where the error is as large as what is
    sought. Raises ValueError where the errors are not numbers: matplotlib would draw their ranks.
    """
    errors = needs["error over noise"]
    if not pd.api.types.is_numeric_dtype(errors):
        raise ValueError("column 'error over noise' holds no numbers, so it cannot be drawn")
    place = np.arange(len(needs)) + 0.8 * (needs["method"] != needs["method"].shift()).cumsum()
    figure, axes = plt.subplots(figsize=(8, 0.27 * len(needs) + 2))
    colours = np.where(needs["suffices"], ORANGE, "silver")
    axes.barh(place, errors.clip(upper=limit), color=colours)
    for row, at in zip(needs.itertuples(), place, strict=True):
        if asked.get(row.method) == row.data:
            axes.plot(1.3 * limit, at, "<", color=RED, ms=8, clip_on=False)
    axes.plot([], [], "s", color=ORANGE, label="these data suffice")
    axes.plot([], [], "s", color="silver", label="these do not")
    axes.plot([], [], "<", color=RED, label="what the paper asks for")
    axes.set(xscale="log", xlim=(0.3, limit), xlabel="error of the translation over the noise [1]")
    axes.set_yticks(place, needs["method"] + ": " + needs["data"])
    axes.invert_yaxis()
    figure.suptitle("With too few data the error does not come from the noise")
    figure.legend(loc="outside lower center", ncols=3)
    return figure
