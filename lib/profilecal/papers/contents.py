"""What the two papers contain, where each part is treated, and what came of it."""

import re
from pathlib import Path

import pandas as pd

from profilecal.papers.scorecard import PAPERS

# paper, part of it, what it is about, numbers of the notebooks
CONTENTS = (
    ("edge", "Figs 1-3", "the frames; groups of scans of one edge", "00 10"),
    ("edge", "Sections 2, 2.1 and 2.2, Eqs 1-35", "the two-phase method; how it errs", "10 12"),
    ("edge", "Section 3, Fig. 4", "robot, scanner, three specimens", "11"),
    ("edge", "Sections 4 and 4.1, Fig. 5", "the criteria Δα and Δd; are 15 rotations enough?", "11 50"),
    ("edge", "Table 1, Fig. 6", "Δα by number of rotations", "11"),
    ("edge", "Table 2, Fig. 7", "Δd by number of rotations", "11"),
    ("edge", "Section 4.2, Table 3, Fig. 8", "the radius of a sphere as a check", "11 12"),
    ("edge", "Section 5", "the wish for a single-phase method", "40 41"),
    ("disk", "Section II, Fig. 1", "the frames", "00 20"),
    ("disk", "Section III, Eqs 1-20, Figs 2-5", "the method: from chords to the sensor pose", "20 21"),
    ("disk", "Section IV, Eqs 21-47, Figs 6-13", "why each step holds; least number of chords", "20"),
    ("disk", "Section V-A, Fig. 14, Table I, Eqs 48-51", "the measured calibration", "21"),
    ("disk", "Section V-B, Eq. 52, Fig. 15", "simulated noise of the chords", "22"),
    ("disk", "Section V-C, Fig. 16", "repeatability", "21"),
    ("disk", "Section V-D1, Table II", "what disk, ball and tetra-ball methods need", "29 30"),
    ("disk", "Section V-D2, Tables III and IV, Eqs 53-56", "the measured ball calibration", "29 30"),
    ("disk", "Section V-D3, Fig. 17", "simulated noise of the ball's arcs", "31"),
)

NUMBER = r"(?:[IVX]+(?:-[A-Z]\d?)?|\d+(?:\.\d+)?(?:-\d+)?)"
REFERENCE = re.compile(rf"(Section|Fig|Eq|Table)s?\.? ({NUMBER}(?:(?:, | and ){NUMBER})*)")


def references(text: str) -> set[tuple[str, str]]:
    """What a text names: "Table I, Eqs 1-2" is {("Table", "I"), ("Eq", "1"), ("Eq", "2")}."""
    found = set()
    for kind, numbers in REFERENCE.findall(text):
        for number in re.split(", | and ", numbers):
            first, _, last = number.partition("-")
            if first.isdigit() and last.isdigit():
                found |= {(kind, str(n)) for n in range(int(first), int(last) + 1)}
            else:
                found.add((kind, number))
    return found


def place(paper: str, item: str) -> int | None:
    """The entry of `CONTENTS` that an item of the scorecard belongs to, None where there is none.

    `paper` as the scorecard names it. A section belongs to its own entry, or else to that of the section it is part of.
    """
    named = references(item)
    whole = {("Section", re.split("[-.]", number)[0]) for kind, number in named if kind == "Section"}
    for names in (named, whole):
        shared = [len(names & references(part)) * (PAPERS[short] == paper) for short, part, *_ in CONTENTS]
        if any(shared):
            return shared.index(max(shared))
    return None


def verdicts(rows: pd.DataFrame) -> str:
    """How many of the scorecard's rows have which verdict, in words."""
    return ", ".join(f"{count} {verdict}" for verdict, count in rows["verdict"].value_counts(sort=False).items())


def contents_map(card: pd.DataFrame, folder: Path) -> str:
    """The map in Markdown: each part of the papers, the notebooks in a folder that treat it, the scorecard's verdicts.

    A notebook with rows of the scorecard on a part is named even where `CONTENTS` does not. Rows that belong to no part
    come last, under their own item.
    """
    card = card.assign(place=[place(paper, item) for paper, item in zip(card["paper"], card["item"], strict=True)])
    entries = [
        (PAPERS[paper], part, about, numbers, card[card["place"] == n])
        for n, (paper, part, about, numbers) in enumerate(CONTENTS)
    ]
    for (paper, item), rows in card[card["place"].isna()].groupby(["paper", "item"], sort=False):
        entries.append((paper, item, "", "", rows))
    lines = ["| paper | part | about | notebooks | numbers compared |", "| --- | --- | --- | --- | --- |"]
    for paper, part, about, numbers, rows in entries:
        treated = {*numbers.split(), *(name[:2] for name in rows["notebook"])}
        links = " ".join(link(number, folder) for number in sorted(treated))
        lines.append(f"| {paper} | {part} | {about} | {links} | {verdicts(rows)} |")
    return "\n".join(lines)


def link(number: str, folder: Path) -> str:
    """A Markdown link to the notebook of that number, or the number where the folder has none."""
    (path, *_) = [*sorted(folder.glob(f"{number}_*.ipynb")), None]
    return f"[{number}]({path.name})" if path else number
