"""The bars of notebook 32 are as long as its table says, not merely there."""

import json
from pathlib import Path

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from profilecal.report import figures
from profilecal.report.needs import plot_needs

NOTEBOOK = Path(__file__).parents[2] / "notebooks" / "32_what_each_method_needs.ipynb"


def bars(axes) -> dict:
    """Length and colour of each bar, by its label."""
    labels = zip(axes.get_yticks(), [label.get_text() for label in axes.get_yticklabels()], strict=True)
    names = {round(place, 6): name for place, name in labels}
    shown = [(round(bar.get_y() + bar.get_height() / 2, 6), bar) for bar in axes.patches]
    return {names[place]: (bar.get_width(), matplotlib.colors.to_hex(bar.get_facecolor())) for place, bar in shown}


def test_bars_of_the_notebook_equal_its_table(monkeypatch):
    monkeypatch.setattr(plt, "show", lambda: None)
    names = {}
    for cell in json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), names)
            if "parameters" in cell["metadata"].get("tags", []):
                names["trials"] = 20
    (axes,) = plt.gcf().axes
    drawn, table = bars(axes), names["needs"]
    limit = np.linalg.norm(names["scans"].T_sensor) / names["noise_mm"]
    assert len(drawn) == len(table)
    assert axes.get_xscale() == "log"
    for row in table.to_dict("records"):
        length, colour = drawn[f"{row['method']}: {row['data']}"]
        assert length == min(row["error over noise"], limit)
        assert (colour.upper() == figures.ORANGE) == row["suffices"]
    plt.close("all")


def test_text_is_refused_and_long_bars_end_at_the_limit():
    table = pd.DataFrame({"method": ["a", "a", "b"], "data": ["1", "2", "1"], "suffices": [False, True, True]})
    with pytest.raises(ValueError, match="holds no numbers"):
        plot_needs(table.assign(**{"error over noise": ["over 100", "2.7", "2.2"]}), {}, 100.0)
    figure = plot_needs(table.assign(**{"error over noise": [np.inf, 2.7, 2.2]}), {"a": "2"}, 100.0)
    assert [length for length, _ in bars(figure.axes[0]).values()] == [100.0, 2.7, 2.2]
    plt.close(figure)
