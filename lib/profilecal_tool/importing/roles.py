"""What columns are, by their titles alone: the one place where that is decided."""

import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from profilecal.scan.conventions import CONVENTIONS, Convention
from profilecal_tool.importing.blocks import Block
from profilecal_tool.importing.makers import ROLES, TABLE, UNITS

KNOWN = "|".join(map(re.escape, sorted(UNITS, key=len, reverse=True)))
IN_BRACKETS = re.compile(r"(.*?)[\s_,/]*[\[(]([^\])]*)[\])]")
BEHIND = re.compile(rf"(.*?)[\s_,/]+({KNOWN})")
NUMBERED = re.compile(r"(.*[^\W\d_])_?(\d+)")


class Column(NamedTuple):
    """What a column of a block is."""

    at: int  # where it stands
    name: str  # its title without a unit
    role: str  # such as x, qw, label; "" for what is not known
    of: str  # what its title names besides: such as tcp in tcp_x
    unit: str  # that its title says


def meaning(at: int, title: str) -> Column:
    """What a title says by itself."""
    text, unit = title.strip().lower(), ""
    if match := IN_BRACKETS.fullmatch(text) or BEHIND.fullmatch(text):
        text, unit = match.groups()
    words = re.sub(r"\W+", "_", text).strip("_").split("_")
    name = "_".join(words)
    for k in range(len(words)):
        if role := ROLES.get("_".join(words[k:])):
            return Column(at, name, role, "_".join(words[:k]), unit)
    return Column(at, name, "", "", unit)


def columns_of(block: Block, said: str = "") -> list[Column]:
    """What the columns of a block are; `said`: by a user, in their order."""
    names = said.split(",")
    is_said = said and len(names) == len(block.titles)
    titles = names if is_said else block.titles
    columns = [meaning(at, title) for at, title in enumerate(titles)]
    if block.is_bare and not is_said:
        return told(block, "", columns)
    for stem, members in numbered(columns).items():
        for column in told(block, stem, members):
            columns[column.at] = column
    return columns


def numbered(columns: Iterable[Column]) -> dict[str, list[Column]]:
    """The columns that are called alike but for their number."""
    stems = defaultdict(list)
    for column in columns:
        if not column.role and (match := NUMBERED.fullmatch(column.name)):
            stems[match[1]].append(column)
    return stems


def told(block: Block, stem: str, columns: list[Column]) -> list[Column]:
    """The columns of numbers behind one name, or none, with what these are; told by how
    many there are, and by the 0 and 1 of a matrix's last row.
    """
    before, _, last = stem.rpartition("_")
    first, _, after = stem.partition("_")
    of = {stem: stem, last: before, first: after}
    lists = [(r, w) for r, words in TABLE["lists"].items() for w in words.split()]
    named = [(roles, of[word]) for roles, word in lists if word in of]
    if not stem or (len(columns) > 2 and meaning(0, stem).role not in {*"xyz"}):
        named += [(roles, stem) for roles in TABLE["bare"].get(str(len(columns)), ())]
    for roles, of in named:
        pairs = [*zip(columns, roles.split(), strict=False)]
        fixed = [(column.at, float(role)) for column, role in pairs if role in "01"]
        fits = all((block.table.iloc[:, at] == value).all() for at, value in fixed)
        fits &= stem != "" or block.table.iloc[0].map(type).ne(str).all()
        if fits and len(roles.split()) == len(columns):
            known = {"0": "", "1": ""}
            return [c._replace(role=known.get(r, r), of=of) for c, r in pairs]
    return columns


def convention_of(roles: Iterable[str]) -> Convention | None:
    """The first convention that is all there."""
    names = {*roles}
    fitting = (one for one in CONVENTIONS if names.issuperset(one.columns))
    return next(fitting, None)


def poses_in(columns: Sequence[Column]) -> dict[str, dict[str, Column]]:
    """The columns of each pose by role: a position, and one convention's angles, of the
    same thing or of nothing else.
    """
    groups = defaultdict(dict)
    for column in columns:
        groups[column.of].setdefault(column.role, column)
    places = {of: own for of, own in groups.items() if own.keys() >= {*"xyz"}}
    loose = {c.role: c for c in columns if c.of not in places or not c.of}
    poses = {}
    for of, own in places.items():
        turns = own if convention_of(own) else loose | own
        if convention := convention_of(turns):
            names = (*"xyz", *convention.columns)
            poses[of] = {name: turns[name] for name in names}
    return poses
