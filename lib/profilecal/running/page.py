"""The report on a user's scans: the notebook run on them, as one HTML file that needs nothing else."""

import tempfile
from datetime import date
from html import escape
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

from tqdm import tqdm

from profilecal.running import notebooks

NOTEBOOK = "60_calibrate_your_scanner.ipynb"
NEEDED = ("papermill", "nbconvert", "ipykernel")


def notebook() -> Path:
    """The report's notebook: inside an installed package, or in the clone."""
    package = Path(__file__).parents[1]
    places = (package / "data" / "notebooks", package.parents[1] / "notebooks")
    return next((place / NOTEBOOK for place in places if (place / NOTEBOOK).is_file()), places[0] / NOTEBOOK)


def check_report(path: Path) -> None:
    """Raise ValueError where no report can be written to `path`, before any work is done."""
    missing = [name for name in NEEDED if find_spec(name) is None]
    if missing:
        raise ValueError(
            f'--report needs {", ".join(missing)}, not installed here: pip install "profilecal[notebooks]"'
        )
    if path.is_dir():
        raise ValueError(f"{path} is a folder; name a file for the report")
    if not path.parent.is_dir():
        raise ValueError(f"{path.parent}: no such folder to write the report to")
    try:
        partial_of(path).touch()
        partial_of(path).unlink()
    except OSError as error:
        raise ValueError(f"{path}: no report can be written there: {error.strerror}") from error


def partial_of(path: Path) -> Path:
    """Where a report is while it is being written."""
    return path.with_name(f".{path.name}.partial")


def write_report(folders, path, **parameters) -> None:
    """Write the report on one scan folder or several of one scanner to the HTML file `path`, whole or not at all.

    `parameters` are further parameters of the notebook. Raises ValueError for a path that cannot be written and
    notebooks.NotebookError with the reason where the notebook fails.
    """
    path = Path(path)
    check_report(path)
    source = notebook()
    parameters |= {"scan": [str(Path(folder).resolve()) for folder in folders]}

    bar = tqdm(total=notebooks.count_cells(source) + 1, desc="report", unit="cell", disable=None, leave=False)
    with tempfile.TemporaryDirectory() as place, bar:
        executed = Path(place) / NOTEBOOK
        try:
            notebooks.run(source, executed, parameters, bar.update)
        except BaseException:
            notebooks.stop_all()
            raise
        page = to_page(executed, "Scanner calibration: " + ", ".join(Path(f).resolve().name for f in folders))
    partial = partial_of(path)
    try:
        partial.write_text(page, encoding="utf-8")
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def to_page(executed: Path, title: str) -> str:
    """An executed notebook as one HTML page: its text and outputs, no code, no scripts, nothing from elsewhere."""
    import nbformat
    from nbconvert import HTMLExporter

    book, heading = nbformat.read(executed, as_version=4), ""
    book.cells = [cell for cell in book.cells[1:] if cell.cell_type == "markdown" or cell.outputs]
    for cell in book.cells:
        if cell.source.startswith("## "):
            heading = cell.source.splitlines()[0][3:]
        cell.metadata["alt"] = heading  # of its pictures
    plain = {"template_name": "basic", "exclude_anchor_links": True}
    exporter = HTMLExporter(exclude_input=True, exclude_output_prompt=True, **plain)
    body, _ = exporter.from_notebook_node(book)
    made = f"profilecal {version('profilecal')}, {date.today().isoformat()}"
    return PAGE.format(title=escape(title), style=STYLE, body=body, made=made)


PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>{style}</style>
</head>
<body>
<header><h1>{title}</h1><p>{made}</p></header>
<main>
{body}
</main>
</body>
</html>
"""
STYLE = """
:root { color-scheme: light; }
body { margin: 0 auto; max-width: 46rem; padding: 1rem; background: white; color: #222;
  font: 1rem/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "Noto Sans", "Liberation Sans", sans-serif; }
header { border-bottom: 1px solid #ccc; margin-bottom: 1rem; }
header p { color: #666; margin: 0 0 .6rem; font-size: .9rem; }
h1 { font-size: 1.5rem; line-height: 1.25; margin: .3rem 0; overflow-wrap: anywhere; }
h2 { font-size: 1.2rem; margin: 2rem 0 .4rem; padding-top: .6rem; border-top: 1px solid #ddd; }
h3, h4 { font-size: 1rem; margin: 1rem 0 .2rem; }
p, ul { margin: .5rem 0; }
ul { padding-left: 1.2rem; }
.verdict { background: #f5f5f5; }
img { display: block; max-width: 100%; height: auto; margin: .3rem auto; }
.scroll { overflow-x: auto; margin: .5rem 0; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: .25rem .7rem; text-align: left; border-bottom: 1px solid #ddd; vertical-align: top; }
th { font-weight: 600; }
pre { background: #f5f5f5; padding: .6rem; margin: .2rem 0 .8rem; overflow-x: auto; font-size: .85rem;
  user-select: all; }
@media (max-width: 36rem) {
  body { padding: .7rem; }
  th, td { padding: .25rem .35rem; }
  pre { white-space: pre-wrap; overflow-wrap: anywhere; font-size: .72rem; }
}
@media print {
  body { max-width: none; padding: 0; font-size: 10pt; }
  pre { white-space: pre-wrap; overflow-wrap: anywhere; }
  .scroll { overflow-x: visible; }
  h2, h3, h4 { break-after: avoid; }
  .text_cell { break-after: avoid; }
  img, tr, pre, .verdict, .text_cell { break-inside: avoid; }
  img { max-width: 75%; max-height: 118mm; width: auto; }
  @page { margin: 18mm 15mm; }
}
"""
