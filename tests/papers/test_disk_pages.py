"""The disk's pages hold what the paper prints: every numbered equation of the method, or why it is left out."""

import json
import re
from pathlib import Path

from profilecal.papers import published
from profilecal.papers.items import items_of

NOTEBOOKS = Path(__file__).parents[2] / "notebooks"
LEFT_OUT = {
    23: "Eq. 4 again, in the frame of chord j",
    25: "Eq. 24 in that frame",
    26: "Eq. 22 of a point of the shifted chord",
    34: "Eq. 1 of two points",
    37: "Eq. 36 with the turn to the frame along the chords, the next step to Eq. 39",
    38: "parallel frames give a vector the same components, said with Eq. 22",
    44: "Eq. 36 of all scans, which Eqs 14 and 45 say",
    46: "Eq. 47 written out",
    48: "names of positions that are not printed",
}


def cells(notebook: str, kind: str) -> list[dict]:
    found = json.loads((NOTEBOOKS / f"{notebook}.ipynb").read_text(encoding="utf-8"))["cells"]
    return [cell for cell in found if cell["cell_type"] == kind]


def test_every_equation_of_the_method_is_typeset_once_or_left_out_for_a_reason():
    text = "".join("".join(cell["source"]) for cell in cells("20_disk_derivation", "markdown"))
    typeset = [int(number) for number in re.findall(r"\\tag\{(\d+)\}", text)]
    assert sorted(typeset + list(LEFT_OUT)) == list(range(1, 49))


def test_the_measured_page_shows_table_i_as_printed():
    outputs = [output for cell in cells("21_disk_measured", "code") for output in cell["outputs"]]
    shown = "".join("".join(output.get("data", {}).get("text/markdown", "")) for output in outputs)
    vectors = published.table("disk").query("item == 'Table I'").groupby(["quantity", "row"])["printed"]
    for _, vector in vectors:
        assert f"({', '.join(vector)})".replace("-", "−") in shown


def test_the_measured_page_compares_every_printed_result():
    found = {item.item: item for item in items_of(NOTEBOOKS / "21_disk_measured.ipynb")}
    assert list(found) == ["Eq. 49", "Eq. 50", "Eq. 51", "Section V-C", "Fig. 16"]
    results = published.table("disk").query("role == 'result'")
    for name, item in found.items():
        printed = results.loc[results["item"] == name, "printed"].tolist()
        readings = 2 if name in ("Section V-C", "Fig. 16") else 1  # of "standard deviation"
        assert [row.printed for row in item.rows] == readings * printed


def test_every_value_printed_for_fig_15_is_compared_under_three_readings():
    (item,) = items_of(NOTEBOOKS / "22_disk_noise.ipynb")
    printed = published.table("disk").query("item == 'Fig. 15'")["printed"]
    assert [row.printed for row in item.rows] == 3 * printed.tolist()
