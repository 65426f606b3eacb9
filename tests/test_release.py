"""What is said in several places is the same in all: the version, the findings."""

import json
import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]


def text_of(name):
    return (ROOT / name).read_text(encoding="utf-8")


def test_versions_agree():
    project = tomllib.loads(text_of("pyproject.toml"))["project"]
    cited = re.search(
        r"^version: (\S+)\ndate-released: (\S+)$", text_of("CITATION.cff"), re.M
    )
    logged = re.search(r"^## (\S+), (\S+)$", text_of("CHANGELOG.md"), re.M)
    assert cited.groups() == logged.groups()
    assert cited[1] == project["version"]


def findings(text):
    """The numbered findings of a page, without its links."""
    section = text.partition("## What we found\n")[2].partition("\n## ")[0]
    numbered = re.findall(r"^\d\. (.*?)\)$", section, re.M | re.S)
    without_links = [re.sub(r"\(\[.*\)", "", item) for item in numbered]
    return [" ".join(item.split()) for item in without_links]


def test_the_first_page_and_the_first_notebook_tell_the_same_findings():
    notebook = json.loads(text_of("notebooks/00_start_here.ipynb"))
    sources = ["".join(cell["source"]) for cell in notebook["cells"]]
    told = findings("\n".join(sources))
    assert len(told) == 5
    assert told == findings(text_of("README.md"))
