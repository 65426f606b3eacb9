"""What the helpers of figures draw is what they are given."""

import pytest

from profilecal_pages import figures


def test_a_limit_in_words_stops_a_page_under_its_own_parameters_alone(monkeypatch):
    assert figures.below([1e-12, -1e-11], 1e-9) == "below 1e-9"
    monkeypatch.setattr(figures, "at_defaults", lambda: False)
    assert figures.below([0, -2e-9], 1e-9) == "2e-9, not below 1e-9"
    monkeypatch.setattr(figures, "at_defaults", lambda: True)
    with pytest.raises(ValueError, match="a value is 2e-09; expected less than 1e-09"):
        figures.below([0, -2e-9], 1e-9)
