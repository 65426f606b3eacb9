"""The dots of notebook 32 lie where its numbers say, not merely anywhere."""

import json
from pathlib import Path

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from profilecal.report import figures
from profilecal.report.needs import plot_needs

NOTEBOOK = Path(__file__).parents[2] / "notebooks" / "32_what_each_method_needs.ipynb"


def dots(axes, label_axes) -> dict:
    """The two ends of each pair and its colour, by its label."""
    labels = zip(label_axes.get_yticks(), [label.get_text() for label in label_axes.get_yticklabels()], strict=True)
    names = {round(place, 6): name for place, name in labels}
    pairs = [line for line in axes.lines if line.get_marker() == "None" and len(line.get_xdata()) == 2]
    return {
        names[round(line.get_ydata()[0], 6)]: (*line.get_xdata(), matplotlib.colors.to_hex(line.get_color()))
        for line in pairs
    }


def test_dots_of_the_notebook_equal_its_numbers(monkeypatch):
    monkeypatch.setattr(plt, "show", lambda: None)
    names = {}
    for cell in json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), names)
            if "parameters" in cell["metadata"].get("tags", []):
                names["trials"] = 20
    table = names["needs"]
    for k, (axes, column) in enumerate(zip(plt.gcf().axes, ("rotation", "translation"), strict=True)):
        drawn = dots(axes, plt.gcf().axes[0])
        assert len(drawn) == len(table)
        assert axes.get_xscale() == "log"
        for row, (key, errors) in zip(table.to_dict("records"), names["found"].items(), strict=True):
            *ends, colour = drawn[": ".join(key)]
            assert ends == [min(error[k], names["sought"][k]) for error in errors]
            assert (colour.upper() == figures.ORANGE) == row[column]
    plt.close("all")


def test_errors_without_an_end_stop_at_what_is_sought():
    table = pd.DataFrame({"method": ["a", "b"], "data": ["1", "2"], "rotation": [True, False], "translation": False})
    errors = np.array([[[2.0, np.inf], [3.0, np.nan]], [[0.2, 1e9], [3.0, 5.0]]])
    figure = plot_needs(table, errors, {"a": "1"}, (180.0, 100.0))
    first, second = (dots(axes, figure.axes[0]) for axes in figure.axes)
    assert [ends[:2] for ends in first.values()] == [(2.0, 0.2), (3.0, 3.0)]
    assert [ends[:2] for ends in second.values()] == [(100.0, 100.0), (100.0, 5.0)]
    plt.close(figure)
