"""What is said in several places is the same in all: the version, the findings."""

import json
import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_versions_agree():
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))[
        "project"
    ]["version"]
    cited = re.search(
        r"^version: (\S+)\ndate-released: (\S+)$",
        (ROOT / "CITATION.cff").read_text("utf-8"),
        re.M,
    )
    logged = re.search(
        r"^## (\S+), (\S+)$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.M
    )
    assert cited.groups() == logged.groups()
    assert cited[1] == version


def findings(text: str) -> list[str]:
    """The numbered findings of a page, without its links."""
    listed = text.partition("## What we found\n")[2].partition("\n## ")[0]
    return [
        " ".join(re.sub(r"\(\[.*\)", "", item).split())
        for item in re.findall(r"^\d\. (.*?)\)$", listed, re.M | re.S)
    ]


def test_the_first_page_and_the_first_notebook_tell_the_same_findings():
    cells = json.loads(
        (ROOT / "notebooks/00_start_here.ipynb").read_text(encoding="utf-8")
    )["cells"]
    told = findings("\n".join("".join(cell["source"]) for cell in cells))
    assert len(told) == 5
    assert told == findings((ROOT / "README.md").read_text(encoding="utf-8"))
