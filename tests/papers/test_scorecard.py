import json

import pytest

from profilecal.papers import scorecard


@pytest.mark.parametrize(
    ("published", "ours", "tolerance", "free", "verdict"),
    [
        (1.0, 1.05, 0.1, "", "reproduced"),
        (1.0, 1.05, 0.1, "scan extent", "compatible"),
        (1.0, 1.15, 0.1, "", "differs"),
        (1.0, 1.15, 0.1, "scan extent", "differs"),
        (None, 1.15, None, "", "unpublished"),
    ],
)
def test_the_verdict_follows_from_the_numbers(published, ours, tolerance, free, verdict):
    row = scorecard.row("disk", "Eq. 1", "x", published, ours, "mm", tolerance, free=free)
    assert list(row) == scorecard.COLUMNS
    assert row["verdict"] == verdict
    assert ("free: scan extent" in row["note"]) == bool(free)


def test_numbers_keep_three_digits_of_their_tolerance():
    row = scorecard.row("edge", "Table 1", "x", 364.25534, 364.241763, "mm", 0.62053)
    assert (row["published"], row["ours"], row["tolerance"]) == (364.255, 364.242, 0.621)


def test_rows_travel_inside_an_executed_notebook(tmp_path):
    rows = [scorecard.row("disk", "Eq. 1", "x", 1.0, 1.05, "mm", 0.1)]
    data = scorecard.Scorecard(rows)._repr_mimebundle_()
    notebook = {"cells": [{"outputs": [{"data": data}]}, {"outputs": [{"text": ["hello"]}]}, {}]}
    (tmp_path / "21_disk.ipynb").write_text(json.dumps(notebook))
    (tmp_path / ".21_disk.ipynb").write_text("half-written")
    gathered = scorecard.gather(tmp_path)
    assert gathered.loc[0, ["notebook", "ours"]].tolist() == ["21_disk", 1.05]
    scorecard.write(gathered, tmp_path)
    assert (
        (tmp_path / "scorecard.csv").read_text().startswith("paper,item,quantity,published,ours,unit,tolerance,verdict")
    )
    assert (
        "| Chen 2018 | Eq. 1 | x | 1 | 1.05 | mm | 0.1 | reproduced | 21_disk |  |"
        in (tmp_path / "scorecard.md").read_text()
    )
