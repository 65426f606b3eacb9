"""What a paper printed beside what we found: rows, verdicts, and how they travel inside executed notebooks."""

import math
from dataclasses import dataclass

import pandas as pd

from profilecal.papers.items import PAPERS

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
