"""What a paper prints beside what we found: one `Item` for each table, equation or
figure.

A notebook shows an item in the paper's own rows and columns. The same output holds it
as data (`MIME`), from which the scorecard is gathered. Every verdict follows from the
numbers shown.
"""

import json
import re
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

MIME = "application/vnd.profilecal.item+json"
PAPERS = {"edge": "Xu 2021", "disk": "Chen 2018"}
VERDICTS = "reproduced", "compatible", "differs"
DIGITS = 2  # of ours, beyond the printed ones, that the data hold


@dataclass(frozen=True)
class Row:
    """One printed number, ours, and the range `low` to `high` in which ours lets us
    expect the printed one.
    """

    row: str  # as the paper names it
    column: str
    quantity: str
    printed: str
    decimals: int  # to which the paper prints it
    unit: str
    ours: float
    low: float
    high: float
    why: str = ""  # it differs
    reading: str = ""  # of a quantity that can be read in several ways

    @property
    def difference(self) -> float:
        """Ours less the printed number."""
        return self.ours - float(self.printed)

    @property
    def inside(self) -> bool:
        """Whether the printed number, within its rounding, lies in our range."""
        # and the rounding of ours
        half = 0.5 * 10.0**-self.decimals + 10.0 ** -(self.decimals + DIGITS)
        return self.low - half <= float(self.printed) <= self.high + half

    @property
    def allowed(self) -> float:
        """How far from ours the range reaches, on the printed number's side."""
        return abs(
            (self.high if float(self.printed) > self.ours else self.low) - self.ours
        )

    @property
    def over_tolerance(self) -> float:
        """The difference as a multiple of what is allowed and half a printed digit; up
        to 1 is inside.
        """
        return abs(self.difference) / (self.allowed + 0.5 * 10.0**-self.decimals)

    @property
    def as_printed(self) -> str:
        """The printed number, with a minus sign."""
        return self.printed.replace("-", "−")

    def shown(self, value: float) -> str:
        """A number to as many decimals as the paper prints."""
        text = f"{value:.{self.decimals}f}"
        return text.replace("-", "−") if float(text) else text.replace("-", "")


@dataclass(frozen=True)
class Item:
    """A table, equation or figure of a paper beside ours, which shows itself. `layout`:
    "table", the paper's rows and columns, printed above ours; "list", a line for each
    number; "matrix", printed, ours and their difference side by side, with how large it
    may be.
    """

    paper: str  # "edge" or "disk"
    item: str  # such as "Table 1"
    what: str  # it is, in our words
    rows: tuple[Row, ...]
    # "rounding", "Monte Carlo" or "settings": where low and high are from; "": ours are
    # exact
    range_from: str = ""
    free: str = ""  # settings that were chosen to agree
    layout: str = "table"

    def verdict(self, row: Row) -> str:
        """reproduced, compatible (where settings were free) or differs."""
        return (
            ("compatible" if self.free else "reproduced") if row.inside else "differs"
        )

    @property
    def inside(self) -> list[bool]:
        """Of each printed number, whether it lies inside our range, under one reading
        at least.
        """
        found = {}
        for row in self.rows:
            found.setdefault((row.row, row.column, row.quantity), []).append(row.inside)
        return list(map(any, found.values()))

    @property
    def statistics(self) -> "dict[str, Item]":
        """Of a table, the part that each of its quantities takes."""
        names = dict.fromkeys(row.quantity for row in self.rows)
        return {
            name: replace(
                self, rows=tuple(row for row in self.rows if row.quantity == name)
            )
            for name in names
        }

    @property
    def summary(self) -> str:
        """How many of the printed numbers lie inside our ranges; of a simulated table,
        for each quantity.
        """
        inside, count = sum(self.inside), len(self.inside)
        free = f" Free: {self.free}." if self.free else ""
        if self.range_from == "Monte Carlo" and self.layout == "table":
            parts = {name: part.inside for name, part in self.statistics.items()}
            counts = ", ".join(
                f"{name} {sum(part)} of {len(part)}" for name, part in parts.items()
            )
            expected = f"about {0.95 * count / len(parts):.0f} of each are expected"
            return (
                f"Printed numbers inside our 95 % ranges: {counts}; {expected}.{free}"
            )
        which = (
            f"inside our ranges ({self.range_from})"
            if self.range_from
            else "that agree with ours"
        )
        reading = ", under one reading at least" if count < len(self.rows) else ""
        return f"Printed numbers {which}: {inside} of {count}{reading}.{free}"

    def _repr_mimebundle_(self, include=None, exclude=None) -> dict:
        frame = {"table": as_table, "list": as_list, "matrix": as_matrices}[
            self.layout
        ](self)
        html = frame.to_html(escape=False, index=self.layout == "table")
        # names of columns that have none
        html = re.sub(r"<tr>\s*(<th></th>\s*)+</tr>\s*", "", html)
        text = frame.replace({"<br>": " | ", "</?b>": ""}, regex=True).to_string(
            index=self.layout == "table"
        )
        title = f"{PAPERS[self.paper]}, {self.item}: {self.what}"
        return {
            "text/plain": f"{title}\n{text}\n{self.summary}",
            "text/html": f"<p><b>{title}</b></p>\n{html}\n<p>{self.summary}</p>",
            MIME: asdict(self),
        }


def as_table(item: Item) -> pd.DataFrame:
    """The paper's rows and columns; printed above ours with its range, and a mark
    inside or outside.
    """
    cells = {}
    for row in item.rows:
        range_ = (
            f" [{row.shown(row.low)}, {row.shown(row.high)}]"
            if row.low < row.high
            else ""
        )
        text = f"<b>{row.as_printed}</b> {'✓' if row.inside else '✗'}<br>{row.shown(row.ours)}{range_}"
        cells.setdefault((row.column, row.quantity), {})[row.row] = text
    columns = sorted(
        cells, key=lambda names: [name for name, _ in cells].index(names[0])
    )
    frame = pd.DataFrame({names: cells[names] for names in columns}).fillna("")
    frame.columns = pd.MultiIndex.from_tuples(columns)
    return frame


def as_list(item: Item) -> pd.DataFrame:
    """A line for each number."""
    lines = []
    for row in item.rows:
        name = ", ".join(
            filter(
                None,
                (
                    " ".join(filter(None, (row.quantity, row.row, row.column))),
                    row.reading,
                ),
            )
        )
        numbers = [row.as_printed, row.shown(row.ours), row.shown(row.difference)]
        over = f"{row.over_tolerance:.2g}"
        # inside or outside, by a little
        over = f"{row.over_tolerance:.2f}" if over == "1" else over
        unit = "" if row.unit == "1" else row.unit
        lines.append([name, *numbers, unit, over, item.verdict(row), row.why])
    columns = [
        "quantity",
        "published",
        "ours",
        "difference",
        "unit",
        "difference / tolerance",
        "verdict",
        "why",
    ]
    frame = pd.DataFrame(lines, columns=columns)
    return frame if frame["why"].any() else frame.drop(columns="why")


def two_digits(value: float) -> str:
    """A positive number to two significant digits, written out."""
    return np.format_float_positional(value, precision=2, fractional=False, trim="-")


def as_matrices(item: Item) -> pd.DataFrame:
    """Printed, ours and their difference side by side, with what is allowed; a rigid
    transform with its last row.
    """

    def difference(row):
        seen = row.allowed > 0.5 * 10.0**-row.decimals  # in the printed digits
        return row.shown(row.difference) + (
            f"<br>±{two_digits(row.allowed)}" if seen else ""
        )

    blocks = {
        "published": lambda row: row.as_printed,
        "ours": lambda row: row.shown(row.ours),
        "difference": difference,
    }
    names = dict.fromkeys(row.row for row in item.rows)
    lines = [[row for row in item.rows if row.row == name] for name in names]
    table = [[text(row) for text in blocks.values() for row in line] for line in lines]
    width = len(table[0]) // 3
    if (len(table), width) == (3, 4):
        table.append([*"0001", *"0001", *"0000"])
    columns = pd.MultiIndex.from_tuples(
        [(block, " " * k) for block in blocks for k in range(width)]
    )
    return pd.DataFrame(table, columns=columns)


def from_json(entry: dict) -> Item:
    """The item that an output of a notebook holds."""
    return Item(**(entry | {"rows": tuple(Row(**row) for row in entry["rows"])}))


def gather(folder: Path) -> list[tuple[str, Item]]:
    """All items of the executed notebooks in a folder, each with its notebook's name,
    in reading order.
    """
    found = []
    for path in sorted(folder.glob("[!.]*.ipynb")):
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        outputs = [
            output.get("data", {})
            for cell in cells
            for output in cell.get("outputs", [])
        ]
        found += [
            (path.stem, from_json(data[MIME])) for data in outputs if MIME in data
        ]
    return found


def tally(gathered) -> pd.DataFrame:
    """Of each item, and each quantity of a table, how many printed numbers are
    reproduced, compatible, or differ.
    """
    lines = []
    for stem, item in gathered:
        parts = {item.item: item}
        if item.layout == "table":
            parts = {
                f"{item.item}, {name}": part for name, part in item.statistics.items()
            }
        for name, part in parts.items():
            inside, count = sum(part.inside), len(part.inside)
            agree = {
                "reproduced": 0 if item.free else inside,
                "compatible": inside if item.free else 0,
            }
            where = {"paper": PAPERS[item.paper], "item": name}
            lines.append(
                where
                | {"printed": count}
                | agree
                | {"differs": count - inside, "notebook": stem}
            )
    return pd.DataFrame(
        lines, columns=["paper", "item", "printed", *VERDICTS, "notebook"]
    )


def sentence(gathered) -> str:
    """How many printed results come out."""
    found = tally(gathered)
    good = found["reproduced"].sum() + found["compatible"].sum()
    return (
        f"{good} of {found['printed'].sum()} printed results come out within what rounding, chance or unprinted "
        "settings allow; each of the others stands with its reason."
    )


def scorecard(gathered) -> pd.DataFrame:
    """A row for each printed number and reading, with its verdict."""
    lines = []
    for stem, item in gathered:
        for row in item.rows:
            about = {"paper": PAPERS[item.paper], "item": item.item} | asdict(row)
            lines.append(
                about
                | {"verdict": item.verdict(row), "free": item.free, "notebook": stem}
            )
    return pd.DataFrame(lines)
