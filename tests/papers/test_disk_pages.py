"""The disk's pages hold what the paper prints: every numbered equation of the method, or why it is left out."""

import json
import re
from pathlib import Path

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
