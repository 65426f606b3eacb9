"""JSON and YAML: lists of samples become rows, whatever is within them columns."""

import json
import re
from collections import defaultdict
from collections.abc import Iterator
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy import ndarray
from pandas import Series, json_normalize

from profilecal.scan.tables import ScanError, naming
from profilecal_tool.importing.array_files import array_blocks
from profilecal_tool.importing.blocks import Block
from profilecal_tool.importing.makers import WORDS

NUMBERED = re.compile(r"(.*?)[_ -]?(\d+)")


class Loader(yaml.CSafeLoader):
    """YAML with the matrices of OpenCV."""


Loader.add_constructor(
    "tag:yaml.org,2002:opencv-matrix",
    lambda loader, node: loader.construct_mapping(node, deep=True)["data"],
)


def nested_blocks(path: Path, text: str) -> Iterator[Block]:
    """The tables of JSON and YAML. Raises ScanError."""
    plain = re.sub(r"\A%YAML.*\n", "", text).replace(".Nan", ".nan")
    is_json = path.suffix.lower() == ".json"
    with naming(path):
        try:
            every = [json.loads(text)] if is_json else yaml.load_all(plain, Loader)
            documents = [one for one in every if isinstance(one, (list, dict))]
        except (yaml.YAMLError, json.JSONDecodeError) as error:
            words = " ".join(str(error).split())
            raise ScanError(f"{path}: {words}; is the file cut short?") from error
        rows = documents[0] if len(documents) == 1 else documents
        yield from nested_tables(path, rows)


def nested_tables(path: Path, node: Any, name: str = "") -> Iterator[Block]:
    """The tables in a list or a dictionary."""
    rows = numbered_rows(node) if isinstance(node, dict) else node
    if not all(isinstance(row, dict) for row in rows):
        rows = [{name: rows}]
    table = json_normalize(rows, sep="_")
    arrays = {}
    for title, cells in table.items():
        inner = cells.explode()
        if all(isinstance(cell, dict) for cell in inner):
            if len(table) > 1:
                inner = [{"nth": k} | row for k, row in inner.items()]
            yield from nested_tables(path, [*inner], title)
        else:
            arrays[title] = array_of_cells(title, cells)
    yield from array_blocks(path, arrays)


def array_of_cells(title: str, cells: Series) -> ndarray:
    """The cells of a column; lists as further dimensions, with NaN where some end, a
    long one by itself.
    """
    if not any(isinstance(cell, list) for cell in cells):
        return cells.to_numpy()
    try:
        lists = [np.array(c if isinstance(c, list) else [], float) for c in cells]
        nothing = np.full(max(lists, key=np.ndim).shape[1:], np.nan)
        array = np.array([*zip_longest(*lists, fillvalue=nothing)]).swapaxes(0, 1)
    except (TypeError, ValueError):
        return cells.astype(str).to_numpy()
    if array.ndim == 2 and title in WORDS["whole_profile"]:
        array = array.reshape(len(cells), -1, 3)
    return array


def numbered_rows(node: dict) -> list[dict]:
    """A dictionary as one row; R_1, t_1, R_2, t_2, … as a row for each number."""
    rows = defaultdict(dict)
    for key, value in node.items():
        match = NUMBERED.fullmatch(str(key))
        if match and isinstance(value, (list, dict)):
            rows[match[2]] |= {"label": match[2], match[1] or "pose": value}
    return [*rows.values()] if len(rows) > 1 else [node]
