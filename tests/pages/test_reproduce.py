"""All notebooks at once, on small ones made here."""

import json
import re

import pytest
from command import run, write_notebook
from distributed import Client

from profilecal_pages import notebooks

PARAMETERS = """
count: int = 2  # [1] how many
scale: float = 0.5  # [mm]
results_dir: str = ""  # [folder]
"""
GOOD = """
import pandas as pd
from profilecal_pages import items
from profilecal_pages import figures
figures.Results("10_good", results_dir).table(pd.DataFrame({"x": [count]}), "counts")
ours = count * scale
row = items.Row("a", "", "x", "1.0", 1, "mm", ours, ours, ours)
items.Item("edge", "Table 1", "lengths", (row,), "rounding")
"""
READ_OTHERS = "import os; print(sorted(os.listdir(executed_dir)))"


@pytest.fixture
def clone(tmp_path, monkeypatch, cluster):
    """A clone with one good notebook, seen by the command. The notebook hands nothing
    out, and so imports nothing.
    """
    (tmp_path / "notebooks").mkdir()
    write_notebook(tmp_path / "notebooks/10_good.ipynb", PARAMETERS, "count * scale")
    monkeypatch.setattr(notebooks, "folder", lambda: tmp_path / "notebooks")
    monkeypatch.setattr(
        notebooks, "workers", lambda: Client(cluster, set_as_default=False)
    )
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_notebooks_run_and_what_they_hand_out_is_gathered(clone):
    results, failing = clone / "results", 'raise RuntimeError("the reason")'
    new = {
        "05_bad": (PARAMETERS, failing),
        "10_good": (PARAMETERS, GOOD),
        "00_all": ('executed_dir: str = ""', READ_OTHERS),
    }
    for name, cells in new.items():
        write_notebook(clone / f"notebooks/{name}.ipynb", *cells)
    result = run("reproduce", "-p", "count", "3")
    assert result.exit_code == 1
    assert "differs" in result.output
    last = result.output.strip().splitlines()[-1]
    sentence = r"FAILED 05_bad: error in cell \d: RuntimeError: the reason \(see "
    assert re.match(sentence + "results/notebooks/05_bad", last)
    assert "the reason" in (results / "notebooks/05_bad.ipynb").read_text()
    assert (results / "tables/10_good_counts.csv").read_text() == "x\n3\n"
    assert "1.5" in (results / "scorecard.csv").read_text()
    last_read = (results / "notebooks/00_all.ipynb").read_text()
    assert "['05_bad.ipynb', '10_good.ipynb']" in last_read
    assert all(cell["execution_count"] for cell in json.loads(last_read)["cells"])


def test_a_second_run_starts_clean(clone):
    more, bench = clone / "notebooks/11_more.ipynb", clone / "results/bench.csv"
    write_notebook(more, "seed: int = 1  # [1]", "open('ran', 'w').close()")
    result = run("reproduce", "11")
    assert result.exit_code == 0, result.output
    assert (clone / "notebooks/ran").exists()

    bench.write_text("kept")
    more.unlink()
    assert run("reproduce").exit_code == 0
    (executed,) = (clone / "results/notebooks").iterdir()
    assert executed.name == "10_good.ipynb"
    assert bench.read_text() == "kept"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ("12", "no notebook named '12'; there are 10_good"),
        ("-p cuont 3", "no parameter named 'cuont'; there are count, scale, results_"),
        ("-p count many", "parameter count is 'many'; expected int"),
        ("--output .", "was not written by this command; name a new or empty folder"),
        ("--output notebooks/10_good.ipynb", "Not a directory"),
    ],
)
def test_mistakes_are_one_sentence_and_touch_nothing(clone, arguments, sentence):
    before = sorted(clone.rglob("*"))
    result = run("reproduce", *arguments.split())
    assert result.exit_code == 2
    assert sentence in result.output
    assert result.output.startswith("profilecal: ")
    assert len(result.output.strip().splitlines()) == 1
    assert sorted(clone.rglob("*")) == before


@pytest.mark.parametrize(
    ("text", "value"),
    [("1e-3", 0.001), ("true", True), ("False", False), ("[1, 2]", [1, 2]), ("", "")],
)
def test_parameters_typed_at_the_command_line(text, value):
    assert repr(notebooks.parse_value(text)) == repr(value)
