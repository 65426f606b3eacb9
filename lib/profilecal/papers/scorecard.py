"""What a paper printed beside what we found: rows, verdicts, and how they travel inside executed notebooks."""

import json
import math
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from profilecal.papers.items import PAPERS, items_of

MIME = "application/vnd.profilecal.scorecard+json"
COLUMNS = ["paper", "item", "quantity", "published", "ours", "unit", "tolerance", "verdict", "notebook", "note"]


def readable(value: float | None, tolerance: float | None) -> float | None:
    """As many digits as are worth comparing: three of the tolerance, or four of the value where there is none."""
    if value is None or not tolerance:
        return None if value is None else float(f"{value:.4g}")
    return round(float(value), max(0, 2 - math.floor(math.log10(tolerance))))


def row(paper, item, quantity, published, ours, unit, tolerance=None, *, free="", note="") -> dict:
    """One row. `free` names settings that were chosen to agree, where there are any.

    The verdict follows from the numbers: "reproduced" within the tolerance, "compatible" if settings were free,
    "differs" outside it, "unpublished" where the paper gives nothing to compare with.
    """
    if published is None:
        verdict = "unpublished"
    elif abs(ours - published) > tolerance:
        verdict = "differs"
    else:
        verdict = "compatible" if free else "reproduced"
    notes = "; ".join(filter(None, (f"free: {free}" if free else "", note)))
    published, ours, tolerance = (readable(number, tolerance) for number in (published, ours, tolerance))
    values = (PAPERS[paper], item, quantity, published, ours, unit, tolerance, verdict, "", notes)
    return dict(zip(COLUMNS, values, strict=True))


@dataclass(frozen=True)
class Scorecard:
    """Rows of one notebook. As a cell's last expression it shows a table and stores the rows in the notebook."""

    rows: list[dict]

    def _repr_mimebundle_(self, include=None, exclude=None) -> dict:
        frame = to_frame(self.rows).drop(columns=["notebook"])
        return {"text/plain": str(frame), "text/html": frame.to_html(index=False, na_rep=""), MIME: self.rows}


def to_frame(rows: list[dict]) -> pd.DataFrame:
    """Rows as a table with the scorecard's columns."""
    return pd.DataFrame(rows, columns=COLUMNS)


def rows_of(notebook: Path) -> list[dict]:
    """The rows that an executed notebook stores, each with the notebook's name."""
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    outputs = [output for cell in cells for output in cell.get("outputs", [])]
    stored = [entry for output in outputs for entry in output.get("data", {}).get(MIME, [])]
    return [entry | {"notebook": notebook.stem} for entry in stored]


def rows_of_items(notebook: Path) -> list[dict]:
    """A row for each printed number that an executed notebook compares."""
    rows = []
    for item in items_of(notebook):
        for row in item.rows:
            name = ", ".join(filter(None, (row.quantity, row.row, row.column, row.reading)))
            numbers = float(row.printed), row.ours, row.unit, (row.high - row.low) / 2
            notes = "; ".join(filter(None, (f"free: {item.free}" if item.free else "", row.why)))
            values = (PAPERS[item.paper], item.item, name, *numbers, item.verdict(row), notebook.stem, notes)
            rows.append(dict(zip(COLUMNS, values, strict=True)))
    return rows


def gather(folder: Path) -> pd.DataFrame:
    """The scorecard of all executed notebooks in a folder, in reading order."""
    paths = sorted(folder.glob("[!.]*.ipynb"))
    return to_frame([entry for path in paths for entry in (*rows_of_items(path), *rows_of(path))])


def to_text(frame: pd.DataFrame) -> pd.DataFrame:
    """The table with its numbers as people read them."""
    frame = frame.copy()
    for column in ("published", "ours", "tolerance"):
        frame[column] = [("" if pd.isna(value) else f"{value:.7g}") for value in frame[column]]
    return frame.fillna("")


def to_markdown(frame: pd.DataFrame) -> str:
    """The table in Markdown."""
    lines = ["| " + " | ".join(frame.columns) + " |", "|" + " --- |" * len(frame.columns)]
    lines += ["| " + " | ".join(map(str, values)) + " |" for values in to_text(frame).itertuples(index=False)]
    return "\n".join(lines) + "\n"


def write(frame: pd.DataFrame, folder: Path) -> None:
    """Write scorecard.csv and scorecard.md."""
    frame.to_csv(folder / "scorecard.csv", index=False)
    (folder / "scorecard.md").write_text(to_markdown(frame), encoding="utf-8")
