"""The derivations typeset every numbered equation of the papers, once, with its number."""

import json
import re
from pathlib import Path

import pytest

NOTEBOOKS = Path(__file__).parents[2] / "notebooks"
NUMBERED = {"10_edge_derivation": set(range(1, 36))}  # of Xu et al. 2021


@pytest.mark.parametrize("name", NUMBERED)
def test_every_numbered_equation_is_typeset(name):
    cells = json.loads((NOTEBOOKS / f"{name}.ipynb").read_text(encoding="utf-8"))["cells"]
    text = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown")
    displayed = re.findall(r"\$\$(.*?)\$\$", text, re.S)
    numbers = [int(number) for equation in displayed for number in re.findall(r"\\tag\{(\d+)\}", equation)]
    assert sorted(numbers) == sorted(NUMBERED[name])
