"""What is said in several places, or refers to another, agrees."""

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


def test_the_first_notebook_sends_readers_to_the_findings():
    notebook = json.loads(text_of("notebooks/00_start_here.ipynb"))
    sources = ["".join(cell["source"]) for cell in notebook["cells"]]
    assert "(../README.md#what-we-found)" in "\n".join(sources)
    section = text_of("README.md").partition("\n## What we found\n")[2]
    assert section.startswith("\n1. ")
