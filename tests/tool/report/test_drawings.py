"""What the helpers of figures draw is what they are given."""

import matplotlib.pyplot as plt
import pytest

from profilecal_pages import figures


@pytest.fixture
def axes():
    plt.switch_backend("agg")
    yield plt.figure().subplots()
    plt.close("all")


def test_a_logarithmic_axis_has_plain_numbers(axes):
    axes.set(yscale="log", ylim=(0.04, 3))
    figures.plain_log(axes.yaxis)
    axes.figure.canvas.draw()
    shown = []
    for label in axes.get_yticklabels():
        _, height = label.get_position()
        if 0.04 < height < 3:
            shown.append(label.get_text())
    assert shown == ["0.05", "0.1", "0.2", "0.5", "1", "2"]


def test_a_limit_in_words_stops_a_page_under_its_own_parameters_alone(monkeypatch):
    assert figures.below([1e-12, -1e-11], 1e-9) == "below 1e-9"
    monkeypatch.setattr(figures, "at_defaults", lambda: False)
    assert figures.below([0, -2e-9], 1e-9) == "2e-9, not below 1e-9"
    monkeypatch.setattr(figures, "at_defaults", lambda: True)
    with pytest.raises(ValueError, match="a value is 2e-09; expected less than 1e-09"):
        figures.below([0, -2e-9], 1e-9)
