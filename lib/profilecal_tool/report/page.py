"""The report on a user's scans, as one HTML file that needs nothing else.

It is the notebook NOTEBOOK, run on them.
"""

import re
import string
import tempfile
from collections.abc import Sequence
from datetime import date
from html import escape
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from profilecal.scan.tables import written_whole
from profilecal_pages import notebooks

NOTEBOOK = "60_calibrate_your_scanner.ipynb"
LINK = re.compile(r"\[([^\]]+)\]\([^)]+\)")


def notebook() -> Path:
    """The report's notebook."""
    return notebooks.shipped("profilecal_tool", f"notebooks/{NOTEBOOK}")


def check_report() -> None:
    """Raise ValueError where no report can be made, before any work is done."""
    packages = ("papermill", "nbconvert", "ipykernel")
    missing = ", ".join(name for name in packages if find_spec(name) is None)
    if missing:
        raise ValueError(
            f"--report needs {missing}, not installed here: "
            'pip install "profilecal[notebooks]"'
        )


def write_report(folders: Sequence[Path], path: Path, **parameters: object) -> None:
    """Write the report on one scan folder or several of one scanner to an HTML file.

    The file `path` appears whole or not at all. `parameters`: others of the notebook.
    Raises notebooks.NotebookError with the reason where it fails.
    """
    source = notebook()
    scans = [folder.resolve() for folder in folders]
    parameters["scan"] = list(map(str, scans))
    title = "Scanner calibration: " + ", ".join(scan.name for scan in scans)
    with tempfile.TemporaryDirectory() as place:
        executed = Path(place) / NOTEBOOK
        bar = {"desc": "report", "disable": None, "leave": False}
        notebooks.run(source, executed, parameters, source.parent, progress=bar)
        page = to_page(executed, title)
    with written_whole(path) as partial:
        partial.write_text(page, "utf-8")


def to_page(executed: Path, title: str) -> str:
    """An executed notebook as one HTML page.

    The page has the text and outputs, no code, no scripts, nothing from elsewhere.
    """
    import nbformat
    from nbconvert import HTMLExporter

    book = nbformat.read(executed, as_version=4)
    book.cells = [cell for cell in book.cells[1:] if is_for_readers(cell)]
    heading = ""
    for cell in book.cells:
        if cell.cell_type == "markdown":
            cell.source = LINK.sub(r"\1", cell.source)  # the page stands alone
        if cell.source.startswith("## "):
            heading = cell.source.splitlines()[0][3:]
        cell.metadata["alt"] = heading  # of its pictures
    exporter = HTMLExporter(
        template_name="basic",
        exclude_input=True,
        exclude_output_prompt=True,
        exclude_anchor_links=True,
    )
    body, _ = exporter.from_notebook_node(book)
    made = f"profilecal {version('profilecal')}, {date.today().isoformat()}"
    frame = Path(__file__).with_name("page.html").read_text("utf-8")
    return string.Template(frame).substitute(title=escape(title), body=body, made=made)


def is_for_readers(cell: Any) -> bool:
    """Whether a cell is text, or has outputs that are not records for a sweep."""
    if cell.cell_type == "markdown":
        return True
    records = [notebooks.MIME in output.get("data", {}) for output in cell.outputs]
    return bool(records) and not any(records)
