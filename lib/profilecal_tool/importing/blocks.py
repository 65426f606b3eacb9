"""What readers make of files: blocks, whose titles tell what columns are."""

import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, Self
from unicodedata import normalize

import numpy as np
from numpy import ndarray
from pandas import DataFrame

from profilecal.scan.conventions import CONVENTIONS, Convention, find_convention
from profilecal.scan.tables import Table, cell_number
from profilecal_tool.importing.makers import (
    OF_POSES,
    ROLE_OF_TITLE,
    ROLES_OF_LIST,
    UNITS,
    WORDS,
    XYZ,
)
from profilecal_tool.importing.questions import one_or_ask

LARGEST_POSE = 16  # numbers of a matrix; a list of more is a profile
BEHIND_WORDS = sorted(UNITS.keys() - WORDS["in_brackets"], key=len, reverse=True)
# x [mm]; but the number in O_T_EE[0] is an index
IN_BRACKETS = re.compile(r"(.*?)[\s_,/]*[\[(](?!\d+[\])])([^\])]*)[\])]")
BEHIND = re.compile(  # A in Grad, x_mm
    rf"(.*?)(?:[\s_]+in)?[\s_,/]+({'|'.join(map(re.escape, BEHIND_WORDS))})"
)


class Column(NamedTuple):
    """What a column of a block is."""

    at: int  # its key in a block's table: from 0 as in the file; others are made here
    title: str  # as it stands there; its number if it has none
    name: str = ""  # the same in small letters, without a unit
    role: str = ""  # such as x, qw, label; "" for what is not known
    owner: str = ""  # what its title names besides: such as tcp in tcp_x or x_tcp
    unit: str = ""  # that its title says

    @property
    def answer(self) -> str:
        """A title that says what it is known to be; `column_titled` reads it again."""
        owned = f"{self.owner}_{self.role}".strip("_")
        name = owned if self.role else self.name or "_"
        return f"{name} [{self.unit}]" if self.unit else name


@dataclass(frozen=True)
class Block:
    """A table in a file, with a pose or a point in each row where one is chosen."""

    path: Path
    table: DataFrame  # the index is where a row stands in the file
    columns: list[Column]  # what the table's columns are
    robot: str = ""  # the maker whose program it is of
    kind: str = "pose"  # of a program's lines: one of `program_lines.KINDS`
    sheet: str = ""  # the name of its sheet, if there are several
    # of a pose, or a point, that is chosen: its columns, by role
    chosen: dict[str, Column] = field(default_factory=dict)
    entry: str = ""  # their name, as --entry says it

    @property
    def titles(self) -> list[str]:
        """The titles of the columns."""
        return [column.title for column in self.columns]

    @property
    def is_bare(self) -> bool:
        """Whether its columns have no titles."""
        return self.titles == counted(len(self.columns))

    def title(self, column: Column) -> str:
        """A column's title, or its number where it has none, one that is another number
        or one that others have too.
        """
        title = column.title
        is_single = self.titles.count(title) == 1
        is_name = is_single and title.strip() and not title.isdecimal()
        return title if is_name else str(column.at + 1)

    def numbers(self, columns: Iterable[Column], blank: bool = False) -> ndarray:
        """Columns as numbers (rows, columns), NaN for blanks if there may be some.

        Raises ScanError.
        """
        cells = {self.title(c): self.table[c.at].to_numpy() for c in columns}
        return Table(self.path, cells, self.table.index).numbers(cells, blank)

    def rows_at(self, rows: Any) -> Self:
        """The same of some rows, by where they stand in the table."""
        return replace(self, table=self.table.iloc[rows])

    @property
    def labels(self) -> dict[str, list[str]]:
        """What may be labels of the rows, by title: columns titled as labels, and
        unknown ones whose values all differ.
        """
        unknown = [c for c in self.having("") if self.table[c.at].is_unique]
        columns = [*self.having("label"), *unknown]
        return {self.title(c): [*map(label_of, self.table[c.at])] for c in columns}

    @property
    def names(self) -> list[str]:
        """The names that a program gives the rows, in small letters; none elsewhere."""
        return [*map(str.lower, self.labels.get("name", []))]

    @cached_property
    def poses(self) -> list[Self]:
        """The poses of its rows, an entry each: a position, and angles of the same
        owner, or else of owners without a position; one for each convention.
        """
        if self.kind != "pose":
            return []
        by_owner: dict[str, dict[str, Column]] = defaultdict(dict)
        for column in self.columns:  # the first of a role counts
            by_owner[column.owner].setdefault(column.role, column)
        placed = {who: of for who, of in by_owner.items() if of.keys() >= {*XYZ}}
        loose = {c.role: c for c in self.columns[::-1] if c.owner not in placed}
        poses = []
        for owner, own in placed.items():
            conventions = conventions_in(own) or conventions_in(loose | own)
            for one in conventions:
                names = [self.robot, owner, one.name if len(conventions) > 1 else ""]
                entry = " ".join(filter(None, names))
                chosen = {role: (loose | own)[role] for role in (*XYZ, *one.columns)}
                poses.append(replace(self, chosen=chosen, entry=entry))
        return poses

    @cached_property
    def unposed(self) -> list[Column]:
        """The columns that are of no pose."""
        posed = {c for pose in self.poses for c in pose.chosen.values()}
        return [column for column in self.columns if column not in posed]

    def having(self, *roles: str) -> list[Column]:
        """The columns of no pose that have some roles, in the order of the roles."""
        return [c for role in roles for c in self.unposed if c.role == role]

    @property
    def convention(self) -> Convention:
        """The convention of a pose's orientation."""
        return find_convention(self.chosen)

    def numbers_of(self, roles: Iterable[str], blank: bool = False) -> ndarray:
        """The numbers (rows, roles) of columns that are chosen, as `numbers`."""
        return self.numbers([self.chosen[role] for role in roles], blank)

    def units(self, roles: Iterable[str]) -> set[str]:
        """The units that titles of columns that are chosen say."""
        return {self.chosen[role].unit for role in roles} - {""}


Poses = Points = Block  # with a pose, or x and z, chosen in each row
Blocks = list[Block]
Files = dict[Path, Blocks]  # the blocks in each file


def conventions_in(roles: dict[str, Column]) -> list[Convention]:
    """The conventions whose columns are all there."""
    return [one for one in CONVENTIONS if roles.keys() >= {*one.columns}]


def of_one_entry(blocks: Blocks, said: str, liked: str, what: str) -> Blocks:
    """The blocks of one entry: the one that a user says; or else one without a name,
    such as x, y, z; or else of the robot, and with a word that is liked, such as
    flange. Raises Question for several.
    """
    wish = said.lower()
    preferences = (
        lambda name: wish in name,  # what is said may be an entry of other files
        lambda name: wish == name,  # where nothing is said, one without a name
        lambda name: not is_of_other(name) and name not in WORDS["on_flange"],
        lambda name: liked in name and name not in WORDS["tool"],  # no flange_offset
    )
    entries = [*dict.fromkeys(block.entry for block in blocks)]
    for preferred in preferences:  # by what counts most first
        entries = [e for e in entries if preferred(e.lower())] or entries
    entry = one_or_ask(blocks[0].path, entries, what, "entry")
    return [block for block in blocks if block.entry == entry]


def columns_titled(table: DataFrame, titles: list[str]) -> list[Column]:
    """What columns are: those with a name each, by the name; a list's numbers by its
    name and by how many there are::

        tcp_x [m], Speed       x of tcp, in m; Speed is not known
        tcp_pos_1 … tcp_pos_3  x, y, z of tcp
        z_1 … z_200            z: a row is a profile
        200 without titles     z, but for a first one that counts rows, nth,
                               or of words, a label
    """
    columns = {column.at: column for column in map(column_titled, table, titles)}
    for name, numbered in lists_among(columns.values()).items():
        is_long = len(numbered) > LARGEST_POSE
        whole = column_titled(0, name)
        axis = whole.role if name else "z"
        # heights have an owner of their own, so that they are no part of a pose
        roles, owner = [], name
        if is_long and axis in XYZ:
            roles = [axis] * len(numbered)
            if not name:
                roles[0] = role_before_heights([*table[numbered[0].at]])
        elif name or titles == counted(len(titles)):
            cells = table[[column.at for column in numbered]]
            roles, owner = roles_of_list(cells, whole.name)
        for column, role in zip(numbered, roles, strict=False):  # none if not known
            unit = column.unit or whole.unit  # of z1 [cm], or of all z_cm_1, z_cm_2, …
            columns[column.at] = column._replace(role=role, owner=owner, unit=unit)
    return [*columns.values()]


def lists_among(columns: Iterable[Column]) -> dict[str, list[Column]]:
    """Columns that are numbered behind one name, by the name; "" for none."""
    lists = defaultdict(list)
    for column in columns:
        if np.isfinite(cell_number(column.title)):
            lists[""].append(column)
        elif match := re.fullmatch(r"(.*[^\W\d_])_?\d+", column.name):
            lists[match[1]].append(column)
    return lists


def roles_of_list(cells: DataFrame, name: str) -> tuple[list[str], str]:
    """The roles of a list's numbers, none if they are not known, and whose they are:
    told by its name, by the name's last word or by its first, or for any name by how
    many there are.

    >>> roles_of_list(DataFrame([[7, 8, 9]]), "tcp_pos")
    (['x', 'y', 'z'], 'tcp')
    >>> roles_of_list(DataFrame([[7, 8, 9]]), "rvec_robot")
    (['rx', 'ry', 'rz'], 'robot')
    >>> matrix = [[1, 0, 0, 7], [0, 1, 0, 8], [0, 0, 1, 9], [0, 0, 0, 1]]
    >>> roles, owner = roles_of_list(DataFrame([sum(matrix, [])]), "T")
    >>> roles[:5], owner
    (['r11', 'r12', 'r13', 'x', 'r21'], 'T')
    >>> roles_of_list(DataFrame([[1, 2, 3, 4, 5, 6]]), "robot_tcp_offset")
    (['x', 'y', 'z', 'rx', 'ry', 'rz'], 'tcp_offset')
    >>> roles_of_list(DataFrame([[1, 2, 3, 4, 5, 6]]), "speeds")  # not known
    ([], 'speeds')
    >>> roles_of_list(DataFrame([[7, 8]]), "")
    (['x', 'z'], '')
    >>> roles_of_list(DataFrame([[7, 8]]), "any")
    ([], 'any')
    """
    count = cells.shape[1]
    before, _, last = name.rpartition("_")
    first, _, after = name.partition("_")
    # words that may tell it, and whose numbers they then are
    owners = [
        (name, name if before else ""),  # q_wxyz; nobody's by one word, such as xyz
        (last, before),  # tcp_pos
        (first, after),  # rvec_robot
        (after, after),  # robot_tcp_offset, a list in a list
    ]
    if not name or count > 2:  # two numbers of any name are no x and z
        owners.append(("bare", name))
    if cells.select_dtypes("number").shape == cells.shape:
        for word, owner in owners:
            for roles in ROLES_OF_LIST.get((word, count), ()):
                if has_constants(cells, roles):
                    return roles, owner
    return [], name


def has_constants(cells: DataFrame, roles: list[str]) -> bool:
    """Whether 0 and 1 stand in the columns whose roles they are, as in a matrix."""
    pairs = zip(cells, roles, strict=True)
    return all(
        cells[at].dropna().eq(int(role)).all() for at, role in pairs if role.isdigit()
    )


def role_before_heights(cells: list) -> str:
    """The role of a first column: of numbers that count the rows, from 0 or 1, nth; of
    words, a label; or else of heights.
    """
    if len(cells) > 1 and only_count(cells):
        return "nth"
    are_words = all(isinstance(cell, str) and cell[:1].isalpha() for cell in cells)
    return "label" if are_words else "z"


def only_count(numbers: Sequence) -> bool:
    """Whether numbers do no more than count, from 0 or 1."""
    counts = [*range(len(numbers) + 1)]
    return [*numbers] in (counts[:-1], counts[1:])


def is_of_other(name: str) -> bool:
    """Whether a name is of something else than the robot."""
    return not WORDS["other"].isdisjoint(re.split(r"[\W\d_]+", name.lower()))


def label_of(cell: Any) -> str:
    """A label: 7 for 7.0, as a column with blanks has it."""
    return f"{cell:.12g}" if isinstance(cell, float) else str(cell)


def counted(count: int) -> list[str]:
    """Titles for columns that have none."""
    return [str(k + 1) for k in range(count)]


def column_titled(at: int, title: str) -> Column:
    """What a title says by itself.

    >>> [column_titled(0, title).unit for title in ("Ｘ（mm）", "x [m]", "O_T_EE[0]")]
    ['mm', 'm', '']
    """
    # in letters and brackets of usual width
    text = normalize("NFKC", title).strip().lower()
    unit = ""
    if match := IN_BRACKETS.fullmatch(text) or BEHIND.fullmatch(text):
        text, unit = match.groups()
    name = re.sub(r"\W+", "_", text).strip("_")
    column = Column(at, title, name, unit=unit)
    words = name.split("_")
    for k in range(len(words)):
        if role := ROLE_OF_TITLE.get("_".join(words[k:])):
            return column._replace(role=role, owner="_".join(words[:k]))
    if name in WORDS["tool"]:  # which tool, such as 3 under TCP
        return column._replace(role="tool")
    role, _, owner = name.partition("_")
    is_owned = role in OF_POSES and owner.isalpha()
    return column._replace(role=role, owner=owner) if is_owned else column
