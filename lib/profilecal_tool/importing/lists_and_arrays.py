"""JSON, YAML and files of arrays: lists of samples become rows, whatever is within them
columns, and so do arrays.
"""

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
from pandas import DataFrame, Series, json_normalize

from profilecal.scan.tables import ScanError, naming
from profilecal_tool.importing.blocks import Block, columns_titled
from profilecal_tool.importing.makers import WORDS

Arrays = dict[str, ndarray]  # by name
SHAPES_OF_POSES = (4, 4), (3, 4), (3, 3), (3, 1), (1, 3)  # what a pose's matrices have


class Loader(yaml.CSafeLoader):
    """YAML with the matrices of OpenCV."""


Loader.add_constructor(
    "tag:yaml.org,2002:opencv-matrix",
    lambda loader, node: loader.construct_mapping(node, deep=True).get("data"),
)


def nested_blocks(path: Path, text: str) -> Iterator[Block]:
    """The blocks of JSON and YAML. Raises ScanError."""
    # OpenCV writes "%YAML:1.0" and ".Nan", which are no YAML
    plain = re.sub(r"\A%YAML.*\n", "", text).replace(".Nan", ".nan")
    suffix = path.suffix.lower()
    if suffix in (".jsonl", ".ndjson"):  # an object a line
        objects = ",\n".join(filter(str.strip, text.splitlines()))
        plain = f"[{objects}]"
    with naming(path):
        try:
            is_json = "json" in suffix
            every = [json.loads(plain)] if is_json else yaml.load_all(plain, Loader)
            documents = [one for one in every if isinstance(one, (list, dict))]
        except (yaml.YAMLError, json.JSONDecodeError) as error:
            words = " ".join(str(error).split())
            raise ScanError(
                f"{path}: {words}; is it cut short, or a list without [ ]?"
            ) from error
        rows = documents[0] if len(documents) == 1 else documents
        yield from blocks_within(path, rows)


def blocks_within(path: Path, node: Any, name: str = "") -> Iterator[Block]:
    """The blocks in a list or a dictionary: {"pose": {"x": 1}} has a column pose_x; a
    list of dictionaries within it is a block of its own, whose rows know their place.
    """
    rows = numbered_rows(node) if isinstance(node, dict) else node
    if not all(isinstance(row, dict) for row in rows):
        rows = [{name: rows}]
    table = json_normalize(rows, sep="_")
    arrays = {}
    for title, cells in table.items():
        inner = cells.explode().dropna()  # a sample may have nothing: []
        if all(isinstance(cell, dict) for cell in inner):
            if len(table) > 1:
                inner = [{"nth": k} | row for k, row in inner.items()]
            yield from blocks_within(path, [*inner], title)
        else:
            arrays[title] = array_of_cells(title, cells)
    yield from array_blocks(path, arrays)


def array_of_cells(title: str, cells: Series) -> ndarray:
    """The cells of a column; lists as further dimensions, with NaN where some end:
    [[1, 2], [3]] is [[1, 2], [3, nan]].
    """
    if not any(isinstance(cell, list) for cell in cells):
        return cells.to_numpy()
    try:
        lists = [np.array(c if isinstance(c, list) else [], float) for c in cells]
        nothing = np.full(max(lists, key=np.ndim).shape[1:], np.nan)
        # pads short lists with rows of NaN; then samples come first again
        array = np.array([*zip_longest(*lists, fillvalue=nothing)]).swapaxes(0, 1)
    except (TypeError, ValueError):
        return cells.astype(str).to_numpy()
    if array.ndim == 2 and title in WORDS["whole_profile"]:  # x, y, z, x, …
        count = array.shape[1]
        if count % 3:
            raise ValueError(
                f"{count} numbers of {title} are no x, y, z; heights: z_1…"
            )
        array = array.reshape(len(cells), -1, 3)
    # one list of matrices or profiles
    return array[0] if array.ndim == 4 and len(array) == 1 else array


def numbered_rows(node: dict) -> list[dict]:
    """A dictionary as one row; R_1, t_1, R_2, t_2, … as a row for each number."""
    rows = defaultdict(dict)
    for key, value in node.items():
        match = re.fullmatch(r"(.*?)[_ -]?(\d+)", str(key))
        if match and isinstance(value, (list, dict)):
            rows[match[2]] |= {"label": match[2], match[1] or "pose": value}
    return [*rows.values()] if len(rows) > 1 else [node]


def binary_blocks(path: Path) -> Iterator[Block]:
    """The blocks of a file of arrays. Raises ScanError."""
    readers = {".mat": matlab_arrays, ".ply": points_of_ply, ".pcd": points_of_pcd}
    try:
        arrays = readers.get(path.suffix.lower(), numpy_arrays)(path)
    except Exception as error:  # each reader has its own
        raise ScanError(f"{path}: no arrays of numbers: is it cut short?") from error
    if all(name[-1:].isdigit() for name in arrays):  # one for each number
        lists = {name: array.tolist() for name, array in arrays.items()}
        yield from blocks_within(path, lists)
    else:
        yield from array_blocks(path, arrays)


def matlab_arrays(path: Path) -> Arrays:
    """The arrays of MATLAB, whose stacks of matrices most often lie along the last
    axis, which then is longer than a matrix.
    """
    from scipy.io import loadmat

    arrays = {}
    for name, cells in loadmat(path, squeeze_me=True).items():
        array = np.asarray(cells)
        if fields := array.dtype.names:  # of a struct array
            arrays |= {f"{name}_{field}": array[field] for field in fields}
        elif name[0] != "_":
            arrays[name] = array
    for name, array in arrays.items():
        if array.ndim == 1 and array.dtype == object:  # cells, of an array each
            each = [np.asarray(cell) for cell in array]
            lists = [(one.T if one.shape[-1:] > (4,) else one).tolist() for one in each]
            arrays[name] = array_of_cells(name, Series(lists))
        elif array.ndim == 3 and array.shape[-1] > 4:
            arrays[name] = np.moveaxis(array, -1, 0)
    return arrays


def points_of_ply(path: Path) -> Arrays:
    """The columns of a point cloud."""
    from plyfile import PlyData

    points = PlyData.read(path)["vertex"].data
    return {name: points[name] for name in points.dtype.names}


def points_of_pcd(path: Path) -> Arrays:
    """The columns of a point cloud of ROS, as text or as numbers of some bytes each."""
    head, _, data = path.read_bytes().partition(b"\nDATA ")
    way, _, points = data.partition(b"\n")
    lines = dict(line.split(" ", 1) for line in head.decode().splitlines())
    names, types, sizes = (lines[k].split() for k in ("FIELDS", "TYPE", "SIZE"))
    codes = zip(names, types, sizes, strict=True)  # F and 4: f4
    fields = [(name, kind.lower() + size) for name, kind, size in codes]
    if way.strip() == b"binary":
        cells = np.frombuffer(points, fields)
    else:  # compressed ones are no text
        cells = np.loadtxt(points.splitlines(), fields, ndmin=1)
    return {name: cells[name] for name in names}


def numpy_arrays(path: Path) -> Arrays:
    """The arrays of NumPy; "" is the name of one alone."""
    with path.open("rb") as file:
        loaded = np.load(file)
        return {"": loaded} if isinstance(loaded, ndarray) else {**loaded}


def array_blocks(path: Path, arrays: Arrays) -> Iterator[Block]:
    """Arrays as blocks: those of as many rows are one, such as poses and their times;
    points of profiles have more rows. One row of x is that of each profile.

    >>> arrays = {"x": np.arange(2), "z": np.array([[5, 6], [7, 8]])}
    >>> next(array_blocks(Path("a.npz"), arrays)).table.to_numpy().tolist()
    [[0, 1, 5, 6], [0, 1, 7, 8]]
    """
    alike = defaultdict(dict)
    x, z = arrays.get("x"), arrays.get("z")
    if np.ndim(x) == 1 and np.shape(z)[1:] == x.shape:  # the same for all
        arrays |= {"x": np.broadcast_to(x, z.shape)}
    for name, array in arrays.items():
        if array.ndim and array.size:
            array = array.astype(array.dtype.newbyteorder("="), copy=False)
            columns = columns_of(name, array)
            alike[len(next(iter(columns.values())))] |= columns
    for rows, columns in alike.items():
        cells = dict(enumerate(columns.values()))
        table = DataFrame(cells, range(1, rows + 1), copy=False)
        yield Block(path, table, columns_titled(table, [*columns]))


def columns_of(name: str, array: ndarray) -> Arrays:
    """The columns of an array, numbered; profiles (n, points, 2 or 3), or
    (n, 2 or 3, points), become a row for each point, with its profile's place, nth.
    """
    columns = {}
    if array.ndim == 3 and array.shape[1:] not in SHAPES_OF_POSES:
        if array.shape[1] in (2, 3):
            array = array.swapaxes(1, 2)
        columns["nth"] = np.arange(len(array), dtype="i4").repeat(array.shape[1])
        name, array = f"{name}_points", array.reshape(-1, array.shape[2])
    if array.ndim == 1:
        return {name: array}
    for k, column in enumerate(array.reshape(len(array), -1).T, 1):
        columns[f"{name}_{k}".strip("_")] = column
    return columns
