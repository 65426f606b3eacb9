"""Profiles of a row each, as heights z, or of two columns each, as x and z: turned into
a row for each point.
"""

import re
from collections import defaultdict
from dataclasses import replace

import numpy as np
from numpy import ndarray
from pandas import DataFrame, concat

from profilecal.scan.tables import ScanError, cell_number, listed
from profilecal_tool.importing.blocks import LARGEST_POSE, Block, Column, only_count
from profilecal_tool.importing.questions import Layout, Question
from profilecal_tool.importing.text_tables import BEGIN

# a name, a unit or none, a number
X_ABOVE = (
    r"(?<![a-z])x[ _-]?(?:{})[ _]*[\[(]?(?:mm)?[\])]?"
    r"[\s\"':=;,]*([-+]?\d+(?:[.,]\d+)?)"
)
MANY_PAIRS = 5  # more than scanners of a robot
START_AND_PITCH = "start|offset|origin", "pitch|resolution|interval|step"


def with_a_point_a_row(block: Block, layout: Layout) -> Block:
    """A block with a point in each row, of one with a profile in each; what stands
    beside is repeated. Raises ScanError where x is nowhere, or where a first column
    may be one of numbers or times.
    """
    block = with_pairs_below(block)
    x, z = longest_list(block, "x"), longest_list(block, "z")
    if len(z) <= LARGEST_POSE:
        return block
    heights = block.numbers(z, blank=True)
    if block.is_bare and len(heights) > 1 and (np.diff(heights[:, 0]) > 0).all():
        raise ScanError(
            f"{block.path}: column {z[0].title} rises from row to row, as numbers and "
            "times do; give titles: n, z1, z2, …"
        )
    repeated = [column for column in block.columns if column not in (*x, *z)]
    for column in repeated:
        kinds = {str(cell).lower() for cell in block.table[column.at]}
        where = f"{block.path}: by column {column.title}, rows are of"
        if {"x", "z"} <= kinds:
            words = "x and of z by turns; give columns x1, z1, x2, z2, …"
            raise ScanError(f"{where} {words}")
        if {"z"} < kinds:
            words = f"{listed(sorted(kinds))}; of z alone?"
            raise Question(f"{where} {words}", where=f"{column.name}=z")
    rows = block.table[[column.at for column in repeated]]
    table = rows.loc[rows.index.repeat(len(z))]
    if len(x) == len(z):
        of_x = x[0].unit, block.numbers(x, blank=True)
    else:
        of_x = "", x_of_heights(block, z, layout)
    further = (
        ("nth", "", np.arange(len(heights))[:, None]),
        ("x", *of_x),
        ("z", z[0].unit, heights),
    )
    for at, (role, unit, cells) in enumerate(further, len(block.columns)):
        table[at] = np.broadcast_to(cells, heights.shape).ravel()
        repeated.append(Column(at, role, role, role, owner="profile", unit=unit))
    return replace(block, table=table, columns=repeated)


def with_pairs_below(block: Block) -> Block:
    """A block with one x and one z, of one in which each profile has its own, side by
    side: p1_x, p1_z, p2_x, …; they stand below one another, labelled p1, p2, …

    >>> from profilecal_tool.importing.blocks import column_titled
    >>> titles = [f"p{k}_{axis}" for k in range(MANY_PAIRS) for axis in "xz"]
    >>> table = DataFrame([range(10), range(10, 20)])
    >>> block = Block("a.csv", table, [*map(column_titled, table, titles)])
    >>> with_pairs_below(block).table.to_numpy()[:3].tolist()
    [['p0', 0, 1], ['p0', 10, 11], ['p1', 2, 3]]
    """
    z_of = {column.owner: column for column in block.having("z")}
    pairs = [(x, z_of[x.owner]) for x in block.having("x") if x.owner in z_of]
    units = {(x.unit, z.unit) for x, z in pairs}
    if len(pairs) < MANY_PAIRS or len(units) > 1:
        return block
    tables = [
        DataFrame({0: x.owner, 1: block.table[x.at], 2: block.table[z.at]})
        for x, z in pairs
    ]
    label, (x, z) = Column(0, "label", role="label"), pairs[0]
    columns = [label, x._replace(at=1, owner=""), z._replace(at=2, owner="")]
    return replace(block, table=concat(tables), columns=columns)


def longest_list(block: Block, axis: str) -> list[Column]:
    """The columns of x, or of z, of the owner that has most of them: of Z Encoder, z_1,
    z_2, … without the first.
    """
    of_owner = defaultdict(list)
    for column in block.having(axis):
        of_owner[column.owner].append(column)
    return max(of_owner.values(), key=len, default=[])


def x_of_heights(block: Block, z: list[Column], layout: Layout) -> ndarray:
    """Where along x the columns of heights z are: in titles that do not only count,
    from 0 or 1, or by a start and a pitch, said or in words where the file begins.
    Raises ScanError where those are not there, or differ.
    """
    places = np.array([cell_number(column.title) for column in z])
    if np.isfinite(places).all() and not (block.is_bare or only_count(places)):
        return places
    start_and_pitch = layout.x
    if not start_and_pitch:
        begin = block.path.read_bytes()[:BEGIN].decode(errors="replace").lower()
        found = [{*re.findall(X_ABOVE.format(one), begin)} for one in START_AND_PITCH]
        if [*map(len, found)] != [1, 1]:
            raise ScanError(
                f"{block.path}: z alone; where is it along x? --x START PITCH says it, "
                "in the unit of z; or give titles: x1, z1, …"
            )
        start_and_pitch = [float(value.replace(",", ".")) for (value,) in found]
    start, pitch = start_and_pitch
    return start + pitch * np.arange(len(z))
