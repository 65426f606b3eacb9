"""What columns are, by their titles alone: the one place where that is decided."""

import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from profilecal.scan.tables import cell_number
from profilecal_tool.importing.makers import (
    ROLE_OF_TITLE,
    ROLES_OF_LIST,
    UNITS,
    convention_of,
)
from profilecal_tool.importing.text_tables import Block

FEWEST = 8  # numbers behind one name that are a profile
MOST = 16  # numbers of a pose, a matrix; a row of more without titles is a profile
KEYS = ("label", "time", "t")  # what may tell profiles apart
KNOWN = "|".join(map(re.escape, sorted(UNITS, key=len, reverse=True)))
IN_BRACKETS = re.compile(r"(.*?)[\s_,/]*[\[(]([^\])]*)[\])]")
BEHIND = re.compile(rf"(.*?)[\s_,/]+({KNOWN})")
NUMBERED = re.compile(r"(.*[^\W\d_])_?(\d+)")


class Column(NamedTuple):
    """What a column of a block is."""

    at: int  # where it stands
    name: str  # its title without a unit
    role: str  # such as x, qw, label; "" for what is not known
    owner: str  # what its title names besides: such as tcp in tcp_x
    unit: str  # that its title says


def meaning_of_title(at: int, title: str) -> Column:
    """What a title says by itself."""
    text, unit = title.strip().lower(), ""
    if abs(cell_number(text)) < float("inf"):
        return Column(at, text, "", "", "")
    if match := IN_BRACKETS.fullmatch(text) or BEHIND.fullmatch(text):
        text, unit = match.groups()
    words = re.sub(r"\W+", "_", text).strip("_").split("_")
    name = "_".join(words)
    for k in range(len(words)):
        if role := ROLE_OF_TITLE.get("_".join(words[k:])):
            return Column(at, name, role, "_".join(words[:k]), unit)
    return Column(at, name, "", "", unit)


def columns_of(block: Block) -> list[Column]:
    """What the columns of a block are."""
    columns = [meaning_of_title(at, title) for at, title in enumerate(block.titles)]
    places = [
        column for column in columns if abs(cell_number(column.name)) < float("inf")
    ]
    if len(places) > (MOST if block.is_bare else FEWEST - 1):
        for column in places:  # z where they stand along x
            columns[column.at] = column._replace(role="z")
    elif block.is_bare:
        return meanings_of_list(block, "", columns)
    for stem, members in numbered_alike(columns).items():
        for column in meanings_of_list(block, stem, members):
            columns[column.at] = column
    return columns


def with_role(columns: Iterable[Column], role: str) -> list[Column]:
    """The columns that have a role."""
    return [column for column in columns if column.role == role]


def numbered_alike(columns: Iterable[Column]) -> dict[str, list[Column]]:
    """The columns that are called alike but for their number."""
    stems = defaultdict(list)
    for column in columns:
        if not column.role and (match := NUMBERED.fullmatch(column.name)):
            stems[match[1]].append(column)
    return stems


def meanings_of_list(block: Block, stem: str, columns: list[Column]) -> list[Column]:
    """The columns of numbers behind one name, or none, with what these are: told by the
    name's first or last word, and by how many there are.
    """
    role = meaning_of_title(0, stem).role
    if role in {*"xyz"} and len(columns) >= FEWEST:
        return [column._replace(role=role, owner=stem) for column in columns]
    before, _, last = stem.rpartition("_")
    first, _, after = stem.partition("_")
    owners = {stem: stem, last: before, first: after}
    if not stem or len(columns) > 2:
        owners["bare"] = stem
    for word, owner in owners.items():
        for roles in ROLES_OF_LIST[word, len(columns)]:
            if can_be_list(block, columns, roles):
                pairs = zip(columns, roles, strict=True)
                return [c._replace(role=role, owner=owner) for c, role in pairs]
    return columns


def can_be_list(block: Block, columns: Sequence[Column], roles: Sequence[str]) -> bool:
    """Whether columns hold no words, and the 0 and 1 of a matrix's last row."""
    cells = [block.table.iloc[:, column.at] for column in columns]
    if any(isinstance(own.iloc[0], str) for own in cells):
        return False
    fixed = [k for k, role in enumerate(roles) if role in ("0", "1")]
    return all((cells[k] == float(roles[k])).all() for k in fixed)


def columns_of_poses(columns: Sequence[Column]) -> dict[str, dict[str, Column]]:
    """The columns of each pose by role, under whose they are: a position, and angles of
    the same owner, or else of none that has a position.
    """
    owned = defaultdict(dict)
    for column in columns:
        owned[column.owner].setdefault(column.role, column)
    placed = {o: roles for o, roles in owned.items() if roles.keys() >= {*"xyz"}}
    loose = {c.role: c for c in columns if c.owner not in placed or not c.owner}
    poses = {}
    for owner, roles in placed.items():
        turned = roles if convention_of(roles) else loose | roles
        if convention := convention_of(turned):
            names = (*"xyz", *convention.columns)
            poses[owner] = {name: turned[name] for name in names}
    return poses


def poses_and_others(columns: Sequence[Column]) -> tuple[list[Column], list[Column]]:
    """The columns of poses, and the others."""
    poses = columns_of_poses(columns).values()
    posed = [column for roles in poses for column in roles.values()]
    return posed, [column for column in columns if column not in posed]
