"""Profiles of a row each, as heights z: turned into a row for each point."""

import re
from dataclasses import replace
from statistics import mode

import numpy as np
from numpy import ndarray

from profilecal.scan.tables import ScanError, cell_number, listed
from profilecal_tool.importing.blocks import LARGEST_POSE, Block, Column, only_count
from profilecal_tool.importing.questions import Layout, Question
from profilecal_tool.importing.text_tables import BEGIN

# a name, a unit or none, a number
X_ABOVE = (
    r"(?<![a-z])x[ _-]?(?:{})[ _]*[\[(]?(?:mm)?[\])]?"
    r"[\s\"':=;,]*([-+]?\d+(?:[.,]\d+)?)"
)
START_AND_PITCH = "start|offset|origin", "pitch|resolution|interval|step"


def with_a_point_a_row(block: Block, layout: Layout) -> Block:
    """A block with a point in each row, of one with a profile in each; what stands
    beside is repeated. Raises ScanError where x is nowhere, or where a first column
    may be one of numbers or times.
    """
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
    of_x = x[0].unit if len(x) == len(z) else ""
    further = (
        ("nth", "", np.arange(len(heights))[:, None]),
        ("x", of_x, x_of_heights(block, layout)),
        ("z", z[0].unit, heights),
    )
    for at, (role, unit, cells) in enumerate(further, len(block.columns)):
        table[at] = np.broadcast_to(cells, heights.shape).ravel()
        repeated.append(Column(at, role, role, role, owner="profile", unit=unit))
    return replace(block, table=table, columns=repeated)


def longest_list(block: Block, axis: str) -> list[Column]:
    """The columns of x, or of z, of the owner that has most of them: of Z Encoder, z_1,
    z_2, … without the first.
    """
    owners = [column.owner for column in block.having(axis)]
    owner = mode(owners) if owners else ""
    return [column for column in block.having(axis) if column.owner == owner]


def x_of_heights(block: Block, layout: Layout) -> ndarray:
    """Where along x the columns of heights are: in columns of their own, in titles that
    do not only count, from 0 or 1, or by a start and a pitch, said or in words where
    the file begins. Raises ScanError where those are not there, or differ.
    """
    x, z = longest_list(block, "x"), longest_list(block, "z")
    if len(x) == len(z):
        return block.numbers(x, blank=True)
    places = np.array([cell_number(column.title) for column in z])
    if np.isfinite(places).all() and not (block.is_bare or only_count(places)):
        return places
    start_and_pitch = layout.x
    if not start_and_pitch:
        begin = block.path.read_bytes()[:BEGIN].decode(errors="replace").lower()
        found = [{*re.findall(X_ABOVE.format(one), begin)} for one in START_AND_PITCH]
        if [*map(len, found)] != [1, 1]:
            raise ScanError(
                f"{block.path}: z alone; where is it along x? --x START PITCH says it; "
                "or give titles: x1, z1, …"
            )
        start_and_pitch = [float(value.replace(",", ".")) for (value,) in found]
    start, pitch = start_and_pitch
    return start + pitch * np.arange(len(z))
