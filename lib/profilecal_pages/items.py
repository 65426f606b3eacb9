"""What a paper prints beside what we found: one `Item` for each table, equation or
figure.

A notebook shows an item in the paper's own rows and columns. The same output holds it
as data (`MIME`), from which the scorecard is gathered. Every verdict follows from the
numbers shown.

An agreement says something only if it could have failed. So each number is computed
again in ways that are wrong on purpose: with a wrong sign, another formula, another
set-up (`Row.otherwise`). Where the printed number then lies outside, the row was seen
to fail, and counts. All other agreements are "not counted".
"""

import json
from collections import Counter, defaultdict
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import pandas as pd

MIME = "application/vnd.profilecal.item+json"
PAPERS = {"edge": "Xu 2021", "disk": "Chen 2018"}
VERDICTS = "reproduced", "compatible", "not counted", "differs"
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
    def over_tolerance(self) -> float:
        """The difference as a multiple of what is allowed on the printed number's side
        and half a printed digit; up to 1 is inside.
        """
        end = self.high if self.difference < 0 else self.low
        return abs(self.difference) / (abs(end - self.ours) + self.half_unit)

    @property
    def as_printed(self) -> str:
        """The printed number, with a minus sign."""
        return self.printed.replace("-", "−")

    def shown(self, value: float) -> str:
        """A number to as many decimals as the paper prints."""
        text = f"{value:.{self.decimals}f}"
        return text.replace("-", "−" if float(text) else "")

    @property
    def ours_shown(self) -> str:
        """Ours with its range, if there is one, on a line of its own."""
        ends = f"<br>[{self.shown(self.low)}, {self.shown(self.high)}]"
        return self.shown(self.ours) + ends * (self.low < self.high)


@dataclass(frozen=True)
class Item:
    """A table, equation or figure of a paper beside ours, which shows itself."""

    paper: str  # "edge" or "disk"
    item: str  # such as "Table 1"
    what: str  # it is, in our words
    rows: tuple[Row, ...]
    # where low and high are from: "rounding", "Monte Carlo" or "settings"; "": ours are
    # exact
    range_from: str = ""
    free: str = ""  # settings that were chosen to agree
    # why its numbers cannot fail: "arithmetic on printed matrices", "a recount of ..."
    apart: str = ""
    # that counts, where its rows read one of the paper's words in several ways
    reading: str = ""
    # the range of the free settings, and the share of it under which at least one
    # number fails
    settings: str = ""
    share_failing: float | None = None

    def verdict(self, row: Row) -> str:
        """differs; not counted, where nothing tried made it fail; compatible, where
        settings were free; or reproduced.
        """
        if not row.inside:
            return "differs"
        if self.apart or not row.failed:
            return "not counted"
        return "compatible" if self.free else "reproduced"

    @property
    def verdicts(self) -> list[str]:
        """Of each row."""
        return [*map(self.verdict, self.rows)]

    @property
    def counted(self) -> "Item":
        """The item with the rows of the reading that counts alone."""
        rows = tuple(row for row in self.rows if row.reading == self.reading)
        return replace(self, rows=rows)

    @property
    def agreements(self) -> dict[str, str]:
        """How many of the printed numbers lie inside our ranges, such as "11 of 12", by
        what was done otherwise.
        """
        inside = defaultdict(list)
        for row in self.rows:
            for name in row.otherwise:
                inside[name].append(name not in row.failed)
        return {name: f"{sum(of)} of {len(of)}" for name, of in inside.items()}

    @property
    def summary(self) -> str:
        """How many of the printed numbers lie inside our ranges, and how many would
        otherwise; what was free; why some differ.
        """
        of = self.counted
        inside = len(of.rows) - of.verdicts.count("differs")
        ranges = f"Inside our ranges ({self.range_from})"
        where = ranges if self.range_from else "As ours"
        said = [f"{where}: {inside} of {len(of.rows)}."]
        if self.reading:
            said.append(f"The reading that counts: {self.reading}.")
        if self.apart:
            said.append(f"Not counted: {self.apart}.")
        elif of.agreements:
            others = "; ".join(map(", ".join, of.agreements.items()))
            said.append(f"If we change one thing: {others}.")
        if self.free:
            said.append(f"Free settings: {self.free}.")
        if self.share_failing is not None:
            said.append(
                f"At least one number fails under {100 * self.share_failing:.3g} % of "
                f"the settings {self.settings}."
            )
        reasons = dict.fromkeys(row.why for row in of.rows if row.why)
        said += [f"✗: {why}." for why in reasons]
        return " ".join(said)

    def _repr_mimebundle_(self, include: object = None, exclude: object = None) -> dict:
        frame = as_table(self)
        html = frame.to_html(escape=False)
        text = frame.replace({"<br>": " | ", "</?b>": ""}, regex=True).to_string()
        title = f"{PAPERS[self.paper]}, {self.item}: {self.what}"
        return {
            "text/plain": f"{title}\n{text}\n{self.summary}",
            "text/html": f"<p><b>{title}</b></p>\n{html}\n<p>{self.summary}</p>",
            MIME: asdict(self),
        }


def as_table(item: Item) -> pd.DataFrame:
    """The paper's rows and columns, or one column for each reading. Ours with its range
    stands below each printed number, or once where it is the same for all columns.
    """
    marks = {"differs": "✗", "not counted": "(✓)"}
    printed, ours = defaultdict(dict), defaultdict(dict)
    for row in item.rows:
        parts = [row.quantity, row.row, row.column if row.reading else ""]
        name = " ".join(filter(None, parts))
        column = row.reading or row.column
        mark = marks.get(item.verdict(row), "✓")
        printed[name][column] = f"<b>{row.as_printed}</b> {mark}"
        ours[name][column] = row.ours_shown
    for name, cells in printed.items():
        if len(cells) > 1 and len({*ours[name].values()}) == 1:
            cells["ours"] = ours[name].popitem()[1]
            continue
        for column, text in ours[name].items():
            cells[column] += f"<br>{text}"
    return pd.DataFrame(printed).T.fillna("")


def in_words(verdicts: list[str]) -> str:
    """How many of which, such as "3 compatible, 1 differs"."""
    counts = {verdict: verdicts.count(verdict) for verdict in VERDICTS}
    return ", ".join(f"{count} {name}" for name, count in counts.items() if count)


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
        notebook = json.loads(path.read_text("utf-8"))
        items += [(path.stem, from_json(entry)) for entry in handed_out(notebook, MIME)]
    return items


def handed_out(notebook: dict, mime: str) -> list:
    """What the outputs of an executed notebook hold under a MIME type."""
    outputs = [out for cell in notebook["cells"] for out in cell.get("outputs", [])]
    return [out["data"][mime] for out in outputs if mime in out.get("data", {})]


def tally(gathered: Gathered) -> pd.DataFrame:
    """Of each item, how many printed numbers have which verdict, under the reading that
    counts.
    """
    lines = []
    for stem, item in gathered:
        verdicts = item.counted.verdicts
        numbers = map(verdicts.count, VERDICTS)
        lines.append([PAPERS[item.paper], item.item, len(verdicts), *numbers, stem])
    columns = ["paper", "item", "printed", *VERDICTS, "notebook"]
    return pd.DataFrame(lines, columns=columns)


def sentence(gathered: Gathered) -> str:
    """What became of the printed results, in counts."""
    count = Counter(mark for _, item in gathered for mark in item.counted.verdicts)
    apart = count["not counted"]
    return (
        f"Of {count.total()} printed results {apart} are not counted: they restate "
        "others, or agree under each change tried. "
        f"Of the other {count.total() - apart}, {count['reproduced']} are reproduced "
        f"from printed inputs, {count['compatible']} are compatible with settings "
        f"that we chose, and {count['differs']} differ."
    )


def scorecard(gathered: Gathered) -> pd.DataFrame:
    """A row for each printed number and reading, with its verdict."""
    lines = [
        {
            "paper": PAPERS[item.paper],
            "item": item.item,
            **asdict(row),
            "verdict": item.verdict(row),
            "would have failed": ", ".join(row.failed),
            "free": item.free,
            "notebook": stem,
        }
        for stem, item in gathered
        for row in item.rows
    ]
    return pd.DataFrame(lines).drop(columns="otherwise", errors="ignore")
