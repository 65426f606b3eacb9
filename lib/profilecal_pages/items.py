"""What a paper prints beside what we found: one `Item` for each table, equation or
figure.

A notebook shows an item in the paper's own rows and columns. The same output holds it
as data (`MIME`), from which the scorecard is gathered. Every verdict follows from the
numbers shown.
"""

import json
import re
from collections import defaultdict
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
    def half_unit(self) -> float:
        """Half of the last printed digit."""
        return 0.5 * 10.0**-self.decimals

    @property
    def difference(self) -> float:
        """Ours less the printed number."""
        return self.ours - float(self.printed)

    @property
    def inside(self) -> bool:
        """Whether the printed number, within its rounding, lies in our range."""
        of_ours = 10.0 ** -(self.decimals + DIGITS)
        rounding = self.half_unit + of_ours
        return self.low - rounding <= float(self.printed) <= self.high + rounding

    @property
    def allowed(self) -> float:
        """How far from ours the range reaches, on the printed number's side."""
        end = self.high if float(self.printed) > self.ours else self.low
        return abs(end - self.ours)

    @property
    def over_tolerance(self) -> float:
        """The difference as a multiple of what is allowed and half a printed digit; up
        to 1 is inside.
        """
        return abs(self.difference) / (self.allowed + self.half_unit)

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
    """A table, equation or figure of a paper beside ours, which shows itself.

    `layout`: "table", the paper's rows and columns, printed above ours; "list", a line
    for each number; "matrix", printed, ours and their difference side by side, with how
    large it may be.
    """

    paper: str  # "edge" or "disk"
    item: str  # such as "Table 1"
    what: str  # it is, in our words
    rows: tuple[Row, ...]
    # where low and high are from: "rounding", "Monte Carlo" or "settings"; "": ours are
    # exact
    range_from: str = ""
    free: str = ""  # settings that were chosen to agree
    layout: str = "table"

    def verdict(self, row: Row) -> str:
        """reproduced, compatible (where settings were free) or differs."""
        if not row.inside:
            return "differs"
        return "compatible" if self.free else "reproduced"

    @property
    def inside(self) -> list[bool]:
        """Of each printed number, whether it lies inside our range, under one reading
        at least.
        """
        inside: dict[tuple, bool] = defaultdict(bool)
        for row in self.rows:
            inside[row.row, row.column, row.quantity] |= row.inside
        return list(inside.values())

    @property
    def statistics(self) -> "dict[str, Item]":
        """Of a table, the part that each of its quantities takes."""
        rows = defaultdict(list)
        for row in self.rows:
            rows[row.quantity].append(row)
        return {name: replace(self, rows=tuple(part)) for name, part in rows.items()}

    @property
    def summary(self) -> str:
        """How many of the printed numbers lie inside our ranges; of a simulated table,
        for each quantity.
        """
        which = "that agree with ours"
        if self.range_from:
            which = f"inside our ranges ({self.range_from})"
        counts = in_numbers(self)
        if len(self.inside) < len(self.rows):
            counts += ", under one reading at least"
        if self.range_from == "Monte Carlo" and self.layout == "table":
            parts = self.statistics
            which = "inside our 95 % ranges"
            each = ", ".join(
                f"{name} {in_numbers(part)}" for name, part in parts.items()
            )
            expected = 0.95 * len(self.inside) / len(parts)
            counts = f"{each}; about {expected:.0f} of each are expected"
        free = f" Free: {self.free}." if self.free else ""
        return f"Printed numbers {which}: {counts}.{free}"

    def _repr_mimebundle_(self, include: object = None, exclude: object = None) -> dict:
        layouts = {"table": as_table, "list": as_list, "matrix": as_matrices}
        frame = layouts[self.layout](self)
        index = self.layout == "table"
        html = frame.to_html(escape=False, index=index)
        # names of columns that have none
        html = re.sub(r"<tr>\s*(<th></th>\s*)+</tr>\s*", "", html)
        plain = frame.replace({"<br>": " | ", "</?b>": ""}, regex=True)
        text = plain.to_string(index=index)
        title = f"{PAPERS[self.paper]}, {self.item}: {self.what}"
        return {
            "text/plain": f"{title}\n{text}\n{self.summary}",
            "text/html": f"<p><b>{title}</b></p>\n{html}\n<p>{self.summary}</p>",
            MIME: asdict(self),
        }


def in_numbers(item: Item) -> str:
    """How many of the printed numbers lie inside our ranges, such as "11 of 12"."""
    return f"{sum(item.inside)} of {len(item.inside)}"


def as_table(item: Item) -> pd.DataFrame:
    """The paper's rows and columns; printed above ours with its range, and a mark
    inside or outside.
    """
    cells: dict[tuple, dict] = defaultdict(dict)
    for row in item.rows:
        cells[row.column, row.quantity][row.row] = as_cell(row)
    # the quantities of a column side by side
    places = [column for column, _ in cells]
    columns = sorted(cells, key=lambda names: places.index(names[0]))
    frame = pd.DataFrame({names: cells[names] for names in columns}).fillna("")
    frame.columns = pd.MultiIndex.from_tuples(columns)
    return frame


def as_cell(row: Row) -> str:
    """The printed number with a mark inside or outside, above ours with its range."""
    mark = "✓" if row.inside else "✗"
    ours = row.shown(row.ours)
    if row.low < row.high:
        ours += f" [{row.shown(row.low)}, {row.shown(row.high)}]"
    return f"<b>{row.as_printed}</b> {mark}<br>{ours}"


def as_list(item: Item) -> pd.DataFrame:
    """A line for each number."""
    lines = [as_line(row) | {"verdict": item.verdict(row)} for row in item.rows]
    frame = pd.DataFrame(lines)
    why = [row.why for row in item.rows]
    return frame.assign(why=why) if any(why) else frame


def as_line(row: Row) -> dict[str, str]:
    """A row's name and numbers, by column."""
    name = " ".join(filter(None, (row.quantity, row.row, row.column)))
    over = f"{row.over_tolerance:.2g}"
    if over == "1":  # inside or outside, by a little
        over = f"{row.over_tolerance:.2f}"
    return {
        "quantity": ", ".join(filter(None, (name, row.reading))),
        "published": row.as_printed,
        "ours": row.shown(row.ours),
        "difference": row.shown(row.difference),
        "unit": "" if row.unit == "1" else row.unit,
        "difference / tolerance": over,
    }


def two_digits(value: float) -> str:
    """A positive number to two significant digits, written out."""
    return np.format_float_positional(value, precision=2, fractional=False, trim="-")


def as_matrices(item: Item) -> pd.DataFrame:
    """Printed, ours and their difference side by side, with what is allowed; a rigid
    transform with its last row.
    """
    lines = defaultdict(list)
    for row in item.rows:
        lines[row.row].append(row)
    table = []
    for line in lines.values():
        printed = [row.as_printed for row in line]
        ours = [row.shown(row.ours) for row in line]
        table.append(printed + ours + [difference_allowed(row) for row in line])
    width = len(table[0]) // 3
    if (len(table), width) == (3, 4):
        table.append([*"0001", *"0001", *"0000"])
    blocks = ["published", "ours", "difference"]
    names = [" " * k for k in range(width)]
    return pd.DataFrame(table, columns=pd.MultiIndex.from_product([blocks, names]))


def difference_allowed(row: Row) -> str:
    """The difference, with how large it may be where the printed digits show that."""
    text = row.shown(row.difference)
    if row.allowed > row.half_unit:
        text += f"<br>±{two_digits(row.allowed)}"
    return text


def from_json(entry: dict) -> Item:
    """The item that an output of a notebook holds."""
    rows = tuple(Row(**row) for row in entry["rows"])
    return Item(**(entry | {"rows": rows}))


# Items of papers, each with the name of the notebook that shows it.
Gathered = list[tuple[str, Item]]


def gather(folder: Path) -> Gathered:
    """All items of the executed notebooks in a folder, each with its notebook's name,
    in reading order.
    """
    items = []
    for path in sorted(folder.glob("[!.]*.ipynb")):
        notebook = json.loads(path.read_text(encoding="utf-8"))
        items += [(path.stem, from_json(entry)) for entry in handed_out(notebook, MIME)]
    return items


def handed_out(notebook: dict, mime: str) -> list:
    """What the outputs of an executed notebook hold under a MIME type."""
    entries = []
    for cell in notebook["cells"]:
        for output in cell.get("outputs", []):
            data = output.get("data", {})
            if mime in data:
                entries.append(data[mime])
    return entries


def tally(gathered: Gathered) -> pd.DataFrame:
    """Of each item, and each quantity of a table, how many printed numbers are
    reproduced, compatible, or differ.
    """
    lines = []
    for stem, item in gathered:
        parts = {item.item: item}
        if item.layout == "table":
            statistics = item.statistics.items()
            parts = {f"{item.item}, {name}": part for name, part in statistics}
        for name, part in parts.items():
            count, inside = len(part.inside), sum(part.inside)
            compatible = inside if item.free else 0
            numbers = count, inside - compatible, compatible, count - inside
            lines.append([PAPERS[item.paper], name, *numbers, stem])
    columns = ["paper", "item", "printed", *VERDICTS, "notebook"]
    return pd.DataFrame(lines, columns=columns)


def sentence(gathered: Gathered) -> str:
    """How many printed results come out."""
    total = tally(gathered)[["printed", *VERDICTS]].sum()
    good = total["reproduced"] + total["compatible"]
    return (
        f"{good} of {total['printed']} printed results come out within what rounding, "
        "chance or unprinted settings allow; each of the others stands with its reason."
    )


def scorecard(gathered: Gathered) -> pd.DataFrame:
    """A row for each printed number and reading, with its verdict."""
    lines = []
    for stem, item in gathered:
        for row in item.rows:
            line = {"paper": PAPERS[item.paper], "item": item.item} | asdict(row)
            line["verdict"] = item.verdict(row)
            line["free"] = item.free
            line["notebook"] = stem
            lines.append(line)
    return pd.DataFrame(lines)
