"""What a paper prints beside what we found: one `Item` for each table, equation or
figure.

A notebook shows an item in the paper's own rows and columns. The same output holds it
as data (`MIME`), from which the scorecard is gathered. Every verdict follows from the
numbers shown.

An agreement says something only if it could have failed. So each number is computed
again in ways that are wrong on purpose: with a wrong sign, another formula, another
set-up (`Row.otherwise`). Where the printed number then lies outside, the row was seen
to fail, and counts. All other agreements are "not testable": shown, not counted.
"""

import json
from collections import defaultdict
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd

MIME = "application/vnd.profilecal.item+json"
PAPERS = {"edge": "Xu 2021", "disk": "Chen 2018"}
VERDICTS = "reproduced", "compatible", "not testable", "differs"
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
    # by what was done otherwise, such as "own arcs": ours, low and high
    otherwise: dict[str, list[float]] = field(default_factory=dict)

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
        return self.lies_inside(self.low, self.high)

    def lies_inside(self, low: float, high: float) -> bool:
        """Whether the printed number, within its rounding, lies in a range."""
        of_ours = 10.0 ** -(self.decimals + DIGITS)
        rounding = self.half_unit + of_ours
        return low - rounding <= float(self.printed) <= high + rounding

    @property
    def failed(self) -> list[str]:
        """Under what the printed number lies outside."""
        ranges = self.otherwise.items()
        return [name for name, (_, *ends) in ranges if not self.lies_inside(*ends)]

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
        return text.replace("-", "−" if float(text) else "")


@dataclass(frozen=True)
class Item:
    """A table, equation or figure of a paper beside ours, which shows itself.

    `layout`: "table", the paper's rows and columns, printed above ours; "list", a line
    for each number; "matrix", printed, ours and their difference one below the other,
    with how large it may be.
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
    # why its numbers cannot fail: "arithmetic on printed matrices", "a recount of ..."
    apart: str = ""
    # which of the paper's words its rows read in several ways, such as "standard
    # deviation": one reading counts, for all items with that word
    word: str = ""
    # the range of the free settings, and the share of it under which at least one
    # number fails
    settings: str = ""
    share_failing: float | None = None

    def verdict(self, row: Row) -> str:
        """differs; not testable, where nothing tried made it fail; compatible, where
        settings were free; or reproduced.
        """
        if not row.inside:
            return "differs"
        if self.apart or not row.failed:
            return "not testable"
        return "compatible" if self.free else "reproduced"

    @property
    def inside(self) -> list[bool]:
        """Of each row, whether the printed number lies inside our range."""
        return [row.inside for row in self.rows]

    @property
    def tried(self) -> list[str]:
        """What was done otherwise."""
        return [*dict.fromkeys(name for row in self.rows for name in row.otherwise)]

    def by(self, what: str) -> "dict[str, Item]":
        """What it is for each `what` of its rows: each "reading", each "quantity"."""
        rows = defaultdict(list)
        for row in self.rows:
            rows[getattr(row, what)].append(row)
        return {name: replace(self, rows=tuple(part)) for name, part in rows.items()}

    @property
    def summary(self) -> str:
        """How many of the printed numbers lie inside our ranges. Under a list or a
        matrix also how many would otherwise, and what was free; a page with tables
        tells both once for all of them.
        """
        which, kind = "that agree with ours", "reading"
        if self.range_from:
            which = f"inside our ranges ({self.range_from})"
        if self.layout == "table":
            which, kind = "inside our 95 % ranges", "quantity"
        counts = ", ".join(
            f"{name} {sum(part.inside)} of {len(part.rows)}".strip()
            for name, part in self.by(kind).items()
        )
        said = [f"Printed numbers {which}: {counts}."]
        others = "; ".join(f"{name}, {passing(self, name)}" for name in self.tried)
        if self.apart:
            said.append(f"Not counted: {self.apart}.")
        elif self.layout != "table":
            if others:
                said.append(f"If we change one thing, this many agree: {others}.")
            if self.free:
                said.append(f"Free settings: {self.free}.")
        if self.share_failing is not None:
            said.append(
                f"At least one number fails under {100 * self.share_failing:.0f} % of "
                f"the settings {self.settings}."
            )
        return " ".join(said)

    def _repr_mimebundle_(self, include: object = None, exclude: object = None) -> dict:
        layouts = {"table": as_table, "list": as_list, "matrix": as_matrices}
        frame = layouts[self.layout](self)
        named = {"index": self.layout == "table", "header": self.layout != "matrix"}
        html = frame.to_html(escape=False, **named)
        plain = frame.replace({"<br>": " | ", "</?b>": ""}, regex=True)
        text = plain.to_string(**named)
        title = f"{PAPERS[self.paper]}, {self.item}: {self.what}"
        return {
            "text/plain": f"{title}\n{text}\n{self.summary}",
            "text/html": f"<p><b>{title}</b></p>\n{html}\n<p>{self.summary}</p>",
            MIME: asdict(self),
        }


def passing(item: Item, name: str) -> str:
    """How many of the printed numbers would lie inside our ranges, such as "11 of 12",
    had we computed otherwise.
    """
    agree = [name not in row.failed for row in item.rows if name in row.otherwise]
    return f"{sum(agree)} of {len(agree)}"


def as_table(item: Item) -> pd.DataFrame:
    """A block of the paper's rows for each quantity. Ours with its range stands below
    each printed number, or once, without a sign, where it is the same for all columns.
    """
    lines: dict[tuple, dict] = defaultdict(dict)
    for row in item.rows:
        lines[row.quantity, row.row][row.column] = row
    table = {}
    for name, line in lines.items():
        cells = {column: marked(row, item) for column, row in line.items()}
        threes = np.array([[row.low, row.ours, row.high] for row in line.values()])
        unsigned = np.sort(threes * np.copysign(1, threes[:, 1:2]))
        if len(line) > 1 and (unsigned == unsigned[0]).all():
            (row, *_) = line.values()
            cells["ours"] = with_range(row, *unsigned[0])
        else:
            for (column, row), three in zip(line.items(), threes, strict=True):
                cells[column] += f"<br>{with_range(row, *three)}"
        table[name] = cells
    return pd.DataFrame(table).T.fillna("")


def marked(row: Row, item: Item) -> str:
    """The printed number with a mark inside or outside, in parentheses where it does
    not count.
    """
    marks = {"differs": "✗", "not testable": "(✓)"}
    return f"<b>{row.as_printed}</b> {marks.get(item.verdict(row), '✓')}"


def with_range(row: Row, low: float, ours: float, high: float) -> str:
    """Ours with its range, if there is one."""
    ends = f" [{row.shown(low)}, {row.shown(high)}]" if low < high else ""
    return row.shown(ours) + ends


def as_list(item: Item) -> pd.DataFrame:
    """A line for each number."""
    lines = [
        as_line(row)
        | {"verdict": item.verdict(row), "would have failed": ", ".join(row.failed)}
        | {"why": row.why}
        for row in item.rows
    ]
    frame = pd.DataFrame(lines)
    return frame.loc[:, (frame != "").any()]


def as_line(row: Row) -> dict[str, str]:
    """A row's name and numbers, by column."""
    name = " ".join(filter(None, (row.quantity, row.row, row.column)))
    over = two_digits(row.over_tolerance)
    if over == "1":  # inside or outside, by a little
        over = f"{row.over_tolerance:.2f}"
    return {
        "quantity": name,
        "reading": row.reading,
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
    """Printed, ours and their difference one below the other, with what is allowed; a
    rigid transform with its last row.
    """
    lines = defaultdict(list)
    for row in item.rows:
        lines[row.row].append(row)
    parts = {
        "published": lambda row: row.as_printed,
        "ours": lambda row: row.shown(row.ours),
        "difference": lambda row: difference_allowed(row, item),
    }
    table = []
    for name, text in parts.items():
        block = [[*map(text, line)] for line in lines.values()]
        if np.shape(block) == (3, 4):
            block.append([*"0000"] if name == "difference" else [*"0001"])
        table += [[name, *block[0]], *(["", *line] for line in block[1:])]
    return pd.DataFrame(table)


def difference_allowed(row: Row, item: Item) -> str:
    """The difference, with how large it may be where the printed digits show that; in
    parentheses where it does not count.
    """
    text = row.shown(row.difference)
    if row.allowed > row.half_unit:
        text += f"<br>±{two_digits(row.allowed + row.half_unit)}"
    return f"({text})" if item.verdict(row) == "not testable" else text


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
    outputs = [out for cell in notebook["cells"] for out in cell.get("outputs", [])]
    return [out["data"][mime] for out in outputs if mime in out.get("data", {})]


def under_one_reading(gathered: Gathered) -> Gathered:
    """The items with the rows that count: of each ambiguous word the one reading under
    which most printed numbers lie inside, in all items where that word stands.
    """
    of_word = defaultdict(list)
    for _, item in gathered:
        of_word[item.word or item.item].append(item.by("reading"))
    chosen = {}
    for word, parts in of_word.items():
        in_all = [name for name in parts[0] if all(name in part for part in parts)]
        chosen[word] = max(
            in_all,
            key=lambda name: sum(sum(part[name].inside) for part in parts),
        )
    return [
        (stem, item.by("reading")[chosen[item.word or item.item]])
        for stem, item in gathered
    ]


def tally(gathered: Gathered) -> pd.DataFrame:
    """Of each item, and each quantity of a table, how many printed numbers have which
    verdict, under the reading that counts.
    """
    lines = []
    for stem, item in under_one_reading(gathered):
        parts = {item.item: item}
        if item.layout == "table":
            quantities = item.by("quantity").items()
            parts = {f"{item.item}, {name}": part for name, part in quantities}
        for name, part in parts.items():
            verdicts = [*map(part.verdict, part.rows)]
            numbers = map(verdicts.count, VERDICTS)
            lines.append([PAPERS[item.paper], name, len(verdicts), *numbers, stem])
    columns = ["paper", "item", "printed", *VERDICTS, "notebook"]
    return pd.DataFrame(lines, columns=columns)


AGREEMENTS = (
    "reproduced from printed inputs",
    "compatible with unprinted settings that we chose",
)


def sentence(gathered: Gathered) -> str:
    """What became of the printed results, in three counts."""
    given: list[str] = []
    chosen: list[str] = []  # where any setting is free
    for _, item in under_one_reading(gathered):
        (chosen if item.free else given).extend(map(item.verdict, item.rows))
    printed = len(given + chosen)
    in_vain = (given + chosen).count("not testable")
    counted = [[v for v in part if v != "not testable"] for part in (given, chosen)]
    agree = [
        f"{len(part) - part.count('differs')} of {len(part)} are {agreement}"
        for part, agreement in zip(counted, AGREEMENTS, strict=True)
        if part
    ]
    return (
        f"Of {printed} printed results {in_vain} could hardly have failed, and do not "
        f"count. Of the others, {', and '.join(agree) or 'none is left'}; for the rest "
        "the pages say why they differ."
    )


def scorecard(gathered: Gathered) -> pd.DataFrame:
    """A row for each printed number and reading, with its verdict."""
    lines = [
        {"paper": PAPERS[item.paper], "item": item.item}
        | asdict(row)
        | {"verdict": item.verdict(row), "would have failed": ", ".join(row.failed)}
        | {"free": item.free, "notebook": stem}
        for stem, item in gathered
        for row in item.rows
    ]
    return pd.DataFrame(lines).drop(columns="otherwise", errors="ignore")
