"""The report on a user's scans: the notebook run on them, as one HTML file that needs
nothing else.
"""

import re
import string
import tempfile
from datetime import date
from html import escape
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

from profilecal.scan.tables import partial_of, remove, whole
from profilecal_pages import notebooks
from profilecal_pages.notebooks import MIME

NOTEBOOK = "60_calibrate_your_scanner.ipynb"
LINK = re.compile(r"\[([^\]]+)\]\([^)]+\)")


def notebook() -> Path:
    """The report's notebook: inside an installed package, or in the clone."""
    package = Path(__file__).parents[1]
    inside = package / "data" / "notebooks" / NOTEBOOK
    return inside if inside.is_file() else package.parents[1] / "notebooks" / NOTEBOOK


def check_report(path: Path) -> None:
    """Raise ValueError where no report can be written to `path`, before any work is
    done.
    """
    missing = ", ".join(
        name
        for name in ("papermill", "nbconvert", "ipykernel")
        if find_spec(name) is None
    )
    if missing:
        raise ValueError(
            f'--report needs {missing}, not installed here: pip install "profilecal[notebooks]"'
        )
    if path.is_dir():
        raise ValueError(f"{path} is a folder; name a file for the report")
    try:
        partial_of(path).touch()
        remove(partial_of(path))
    except OSError as error:
        raise ValueError(
            f"{path}: no report can be written there: {error.strerror}"
        ) from error


def write_report(folders, path, **parameters) -> None:
    """Write the report on one scan folder or several of one scanner to the HTML file
    `path`, whole or not at all. `parameters`: others of the notebook. Raises
    notebooks.NotebookError with the reason where it fails.
    """
    source = notebook()
    parameters |= {"scan": [str(Path(folder).resolve()) for folder in folders]}
    with tempfile.TemporaryDirectory() as place:
        executed = Path(place) / NOTEBOOK
        bar = {"desc": "report", "disable": None, "leave": False}
        notebooks.run(source, executed, parameters, source.parent, progress=bar)
        page = to_page(
            executed,
            "Scanner calibration: "
            + ", ".join(Path(f).resolve().name for f in folders),
        )
    with whole(path) as partial:
        partial.write_text(page, encoding="utf-8")


def to_page(executed: Path, title: str) -> str:
    """An executed notebook as one HTML page: its text and outputs, no code, no scripts,
    nothing from elsewhere.
    """
    import nbformat
    from nbconvert import HTMLExporter

    book, heading = nbformat.read(executed, as_version=4), ""
    book.cells = [
        cell for cell in book.cells[1:] if cell.cell_type == "markdown" or cell.outputs
    ]
    book.cells = [
        c
        for c in book.cells
        if not any(MIME in o.get("data", {}) for o in c.get("outputs", []))
    ]
    for cell in book.cells:
        if cell.cell_type == "markdown":
            cell.source = LINK.sub(r"\1", cell.source)  # the page stands alone
        if cell.source.startswith("## "):
            heading = cell.source.splitlines()[0][3:]
        cell.metadata["alt"] = heading  # of its pictures
    options = {
        "exclude_input": True,
        "exclude_output_prompt": True,
        "exclude_anchor_links": True,
    }
    body, _ = HTMLExporter(template_name="basic", **options).from_notebook_node(book)
    made = f"profilecal {version('profilecal')}, {date.today().isoformat()}"
    frame = string.Template(
        Path(__file__).with_name("page.html").read_text(encoding="utf-8")
    )
    return frame.substitute(title=escape(title), body=body, made=made)
