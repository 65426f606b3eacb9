"""The report: notebook 60, executed for a user's scans, as one page that needs nothing
else.
"""

import re
from collections.abc import Sequence
from datetime import date
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

from profilecal.scan.tables import written_whole
from profilecal_pages.notebooks import run, shipped

PACKAGES = "papermill", "nbconvert", "ipykernel"


def notebook() -> Path:
    """The notebook that becomes the report."""
    name = "notebooks/60_calibrate_your_scanner.ipynb"
    return shipped("profilecal_tool", name)


def check_report() -> None:
    """Raise ValueError where what a report takes is not installed."""
    missing = [name for name in PACKAGES if find_spec(name) is None]
    if missing:
        raise ValueError(
            f"--report needs {', '.join(missing)}, not installed here: "
            'pip install "profilecal[notebooks]"'
        )


def write_report(folders: Sequence[Path], path: Path, **parameters: object) -> None:
    """Write the report on scan folders, calibrated with other parameters of the
    notebook. Raises NotebookError, OSError.
    """
    import nbformat
    from nbconvert import HTMLExporter

    places = [folder.resolve() for folder in folders]
    parameters["scan"] = [*map(str, places)]
    with TemporaryDirectory() as scratch:
        executed = Path(scratch, "executed.ipynb")
        bar = {"desc": "report", "leave": False, "disable": None}
        run(notebook(), executed, parameters, Path(scratch), progress=bar)
        pages = nbformat.read(executed, as_version=4)
    pages.cells = pages.cells[1:-1]  # between its title and what a sweep wants
    exporter = HTMLExporter(
        template_name="basic",
        template_file=str(Path(__file__).with_name("page.html")),
        exclude_input=True,
        exclude_input_prompt=True,
        exclude_output_prompt=True,
        exclude_anchor_links=True,
    )
    names = ", ".join(place.name for place in places)
    made = f"profilecal {version('profilecal')}, {date.today()}"
    html, _ = exporter.from_notebook_node(pages, {"names": names, "made": made})
    with written_whole(path) as partial:
        # its links would lead nowhere
        partial.write_text(re.sub(r"</?a\b[^>]*>", "", html), "utf-8")
