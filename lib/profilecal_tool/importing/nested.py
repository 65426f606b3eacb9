"""JSON and YAML: lists of samples become rows, whatever is within them columns."""

import json
import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from pandas import DataFrame, Series, concat, json_normalize

from profilecal.scan.tables import ScanError, naming
from profilecal_tool.importing.arrays import array_blocks
from profilecal_tool.importing.blocks import Block
from profilecal_tool.importing.makers import SETS

LONGEST = 16  # numbers of a pose; longer lists are tables of their own
NUMBERED = re.compile(r"(.*?)[_ -]?(\d+)")


class Loader(yaml.CSafeLoader):
    """YAML with the matrices of OpenCV."""


Loader.add_constructor(
    "tag:yaml.org,2002:opencv-matrix",
    lambda loader, node: loader.construct_mapping(node, deep=True)["data"],
)


def nested_blocks(path: Path, text: str) -> Iterator[Block]:
    """The tables of JSON, of lines of JSON and of YAML. Raises ScanError."""
    with naming(path):
        try:
            documents = [one for one in parsed(text) if one is not None]
        except (yaml.YAMLError, json.JSONDecodeError) as error:
            words = " ".join(str(error).split())
            raise ScanError(f"{path}: {words}; is the file cut short?") from error
        yield from tables(path, documents if len(documents) > 1 else documents[0])


def parsed(text: str) -> list:
    """The documents in a text."""
    if text.lstrip()[:1] not in ("{", "["):
        plain = re.sub(r"\A%YAML.*\n", "", text).replace(".Nan", ".nan")
        return [*yaml.load_all(plain, Loader)]
    try:
        return [json.loads(text)]
    except json.JSONDecodeError:
        return [json.loads(line) for line in text.splitlines() if line.strip()]


def tables(path: Path, node: Any, name: str = "") -> Iterator[Block]:
    """The tables in a list or a dictionary."""
    rows = by_number(node) if isinstance(node, dict) else node
    if not all(isinstance(row, dict) for row in rows):
        array = numbers(rows)
        if array is not None and array.ndim == 1 and name in SETS["whole_profile"]:
            array = array.reshape(-1, 3)
        if array is not None:
            yield from array_blocks(path, {name: array})
        return
    table = json_normalize(rows, sep="_")
    table.index += 1
    columns, lists = [], defaultdict(list)
    for title, cells in table.items():
        if not any(isinstance(cell, list) for cell in cells):
            columns.append(cells)
        elif (wide := in_columns(title, cells)) is not None:
            columns.append(wide)
        elif len(table) == 1:
            yield from tables(path, cells.iloc[0], title)
        elif all(isinstance(cell, list) for cell in cells):
            lists[tuple(map(len, cells))].append(title)
    for alike in lists.values():  # lists of x and of z are columns of one table
        points = table[alike].explode(alike).rename_axis("label").reset_index()
        yield from tables(path, points.to_dict("records"), "points")
    if columns:
        joined = concat(columns, axis=1)
        yield Block(path, joined, [*joined.columns], name=name)


def by_number(node: dict) -> list[dict]:
    """A dictionary as one row; R_1, t_1, R_2, t_2, … as a row for each number."""
    rows = defaultdict(dict)
    for key, value in node.items():
        match = NUMBERED.fullmatch(str(key))
        if match and isinstance(value, (list, dict)):
            rows[match[2]] |= {"label": match[2], match[1]: value}
    return [*rows.values()] if len(rows) > 1 else [node]


def numbers(cell: Any) -> np.ndarray | None:
    """Lists of numbers as an array; None for others."""
    try:
        return np.array(cell, dtype=float)
    except (TypeError, ValueError):
        return None


def in_columns(title: str, cells: Series) -> DataFrame | None:
    """Short lists of as many numbers, in columns; None for others."""
    rows = [numbers(cell) for cell in cells]
    if any(row is None or row.size != rows[0].size for row in rows):
        return None
    if not 0 < rows[0].size <= LONGEST:
        return None
    values = np.reshape(rows, (len(rows), -1))
    return DataFrame(values, cells.index).add_prefix(f"{title}_")
