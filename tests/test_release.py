"""What is said in several places, or refers to another, agrees."""

import re
import tomllib
from pathlib import Path

from profilecal_pages import items

ROOT = Path(__file__).parents[1]


def text_of(name):
    return (ROOT / name).read_text(encoding="utf-8")


README = " ".join(text_of("README.md").split())
GATHERED = items.gather(ROOT / "notebooks")


def test_versions_agree():
    project = tomllib.loads(text_of("pyproject.toml"))["project"]
    cited = re.search(
        r"^version: (\S+)\ndate-released: (\S+)$", text_of("CITATION.cff"), re.M
    )
    logged = re.search(r"^## (\S+), (\S+)$", text_of("CHANGELOG.md"), re.M)
    assert cited.groups() == logged.groups()
    assert cited[1] == project["version"]


def test_readme_and_changelog_are_short():
    assert len(README.split()) <= 600
    news = text_of("CHANGELOG.md").split("\n## ")[1]
    assert len(list(filter(None, news.splitlines()))) <= 40


def test_readme_tells_the_counts_of_the_pages_and_what_differs():
    assert items.sentence(GATHERED) in README
    rows = [row for _, item in GATHERED for row in item.counted.rows if row.why]
    assert len(rows) == 4
    for row in rows:
        unit = " mm" * (row.unit == "mm")
        assert re.search(f"{row.printed}{unit}, ours {row.shown(row.ours)}", README)


def test_the_first_notebook_tells_the_findings():
    assert "## What we found" in text_of("notebooks/00_start_here.ipynb")
    assert "notebooks/00_start_here.ipynb): what we found" in README
