"""Items: the paper's table with ours beside it, as shown and as data."""

import json

import numpy as np
import pytest

from profilecal_pages import items
from profilecal_papers import published
from profilecal_papers.comparison import compare

MEAN = "mean of delta d"


def table(ours, half=0.02, **about):
    printed = published.values("edge", "Table 2", MEAN)
    within = {MEAN: np.full(printed.shape, half)}
    about = {"range_from": "Monte Carlo"} | about
    return compare(
        "edge", "Table 2", "distances", {MEAN: printed + ours}, within=within, **about
    )


def test_every_verdict_follows_from_the_numbers():
    inside = table(0.01)
    outside = table(0.03, why={MEAN: "drawn too large"}, free="radius")
    assert {inside.verdict(row) for row in inside.rows} == {"reproduced"}
    assert inside.summary.endswith(
        f"inside our 95 % ranges: {MEAN} 12 of 12; about 11 of each are expected."
    )
    assert {outside.verdict(row) for row in outside.rows} == {"differs"}
    assert {row.why for row in outside.rows} == {"drawn too large"}
    assert table(0.01, free="radius").verdict(inside.rows[0]) == "compatible"
    assert outside.rows[0].over_tolerance == pytest.approx(0.03 / (0.02 + 0.005))


def test_what_rounds_to_the_printed_number_is_inside():
    assert table(0.0049, half=0.0).rows[0].inside
    sentence = r"Table 2, G=10, parallel bar, .*: .* differs from 0.27; say why"
    with pytest.raises(ValueError, match=sentence):
        table(0.0062, half=0.0)


def shown(item, kind):
    return item._repr_mimebundle_()[f"text/{kind}"]


def test_a_table_is_shown_as_the_paper_prints_it():
    html = shown(table(0.01, labels={MEAN: "mean(Δd)"}), "html")
    assert "mean(Δd)" in html
    for text in published.entries("edge", "Table 2", MEAN)["printed"]:
        assert f"<b>{text}</b> ✓<br>" in html


def pose_within(half):
    """Eq. 49 beside itself."""
    pose = published.values("disk", "Eq. 49", "Lambda")
    within = {"Lambda": np.full(pose.shape, half)}
    about = {"range_from": "rounding", "layout": "matrix"}
    return compare("disk", "Eq. 49", "pose", {"Lambda": pose}, within=within, **about)


def test_a_matrix_stands_beside_ours_and_their_difference():
    lines = shown(pose_within(0.0), "plain").splitlines()
    assert lines[-3].split()[3::4] == ["364.25534", "364.25534", "0.00000"]
    assert lines[-2].split() == [*"000100010000"]
    html = shown(pose_within(0.00123), "html")
    assert "<td>0.00000<br>±0.0012</td>" in html
    assert "<th></th>" not in html


def test_a_quantity_read_in_two_ways_stands_twice():
    key = "standard deviation from Eq. 49"
    ours = {
        (key, "mean of the norms"): np.array(0.326),
        (key, "root mean square"): np.array(0.342),
    }
    why = {(key, "mean of the norms"): "the paper computed the other"}
    about = {"why": why, "range_from": "rounding", "layout": "list"}
    found = compare("disk", "Section V-D2", "spread", ours, **about)
    assert [found.verdict(row) for row in found.rows] == ["differs", "reproduced"]
    assert "root mean square" in shown(found, "plain")
    assert found.summary == (
        "Printed numbers inside our ranges (rounding): 1 of 1, under one reading at "
        "least."
    )


def test_read_back_from_a_notebook(tmp_path):
    item = table(0.01)
    data = json.loads(json.dumps(item._repr_mimebundle_()))
    notebook = {"cells": [{"cell_type": "code", "outputs": [{"data": data}]}]}
    (tmp_path / "11.ipynb").write_text(json.dumps(notebook), encoding="utf-8")
    gathered = items.gather(tmp_path)
    assert gathered == [("11", item)]
    (line,) = items.tally(gathered).to_dict("records")
    assert (line["paper"], line["item"]) == ("Xu 2021", f"Table 2, {MEAN}")
    assert (line["printed"], line["reproduced"], line["notebook"]) == (12, 12, "11")
    assert line["compatible"] == line["differs"] == 0
    assert items.sentence(gathered).startswith("12 of 12 printed results come out")
    frame = items.scorecard(gathered)
    assert (frame["verdict"] == "reproduced").all()
    printed = published.entries("edge", "Table 2", MEAN)["printed"]
    assert frame["printed"].tolist() == printed.tolist()
