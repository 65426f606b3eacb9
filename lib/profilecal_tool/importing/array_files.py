"""Arrays of NumPy, MATLAB and PLY, sheets."""

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy import ndarray
from pandas import DataFrame, read_excel

from profilecal.scan.tables import ScanError
from profilecal_tool.importing.blocks import Block
from profilecal_tool.importing.text_tables import text_blocks

OF_POSES = (4, 4), (3, 4), (3, 3), (3, 1), (1, 3)  # what a pose's matrices have


def binary_blocks(path: Path) -> Iterator[Block]:
    """The tables of a file of arrays. Raises ScanError."""
    reader = {".mat": matlab_arrays, ".ply": points_of_ply}
    try:
        arrays = reader.get(path.suffix.lower(), numpy_arrays)(path)
    except Exception as error:  # each reader has its own
        raise ScanError(f"{path}: no arrays of numbers: is it cut short?") from error
    yield from array_blocks(path, arrays)


def matlab_arrays(path: Path) -> dict[str, ndarray]:
    """The arrays of MATLAB, whose stacks of matrices lie along the last axis."""
    from scipy.io import loadmat

    content = loadmat(path, appendmat=False, squeeze_me=True)
    arrays = {n: np.asarray(cells) for n, cells in content.items() if n[0] != "_"}
    stacks = {n: np.moveaxis(a, -1, 0) for n, a in arrays.items() if a.ndim == 3}
    return arrays | stacks


def points_of_ply(path: Path) -> dict[str, ndarray]:
    """The columns of a point cloud."""
    from plyfile import PlyData

    points = PlyData.read(path)["vertex"].data
    return {name: points[name] for name in points.dtype.names}


def numpy_arrays(path: Path) -> dict[str, ndarray]:
    """The arrays of NumPy; "" is the name of one alone."""
    with path.open("rb") as file:
        loaded = np.load(file, allow_pickle=False)
        return {"": loaded} if isinstance(loaded, ndarray) else {**loaded}


def array_blocks(path: Path, arrays: Mapping[str, ndarray]) -> Iterator[Block]:
    """Arrays as tables: those of as many rows are one; points of profiles, another."""
    alike = defaultdict(dict)
    for name, array in arrays.items():
        if array.ndim and array.size:
            array = array.astype(array.dtype.newbyteorder("="), copy=False)
            columns = columns_of(name, array)
            alike[len(next(iter(columns.values())))] |= columns
    for rows, columns in alike.items():
        cells = dict(enumerate(columns.values()))
        table = DataFrame(cells, range(1, rows + 1), copy=False)
        yield Block(path, table, [*columns])


def columns_of(name: str, array: ndarray) -> dict[str, ndarray]:
    """The columns of an array, numbered; of profiles (n, points, 2 or 3), or of their
    transposes, those of a point in each row.
    """
    columns = {}
    if array.ndim == 3 and array.shape[1:] not in OF_POSES:
        if array.shape[1] in (2, 3):
            array = array.swapaxes(1, 2)
        nth = np.arange(len(array), dtype="i4")
        columns["nth"] = nth.repeat(array.shape[1])
        name, array = f"{name}_points", array.reshape(-1, array.shape[2])
    if array.ndim == 1:
        return {name: array}
    for k, column in enumerate(array.reshape(len(array), -1).T, 1):
        columns[f"{name}_{k}".strip("_")] = column
    return columns


def sheet_blocks(path: Path) -> Iterator[Block]:
    """The tables of a workbook; in several sheets, blank rows part none.

    Raises ScanError.
    """
    try:
        sheets = read_excel(path, sheet_name=None, header=None)
    except Exception as error:  # of the archive, of its XML, of pandas
        raise ScanError(f"{path}: no workbook: is it damaged?") from error
    is_one = len(sheets) == 1
    for name, cells in sheets.items():
        text = cells.to_csv(sep=";", header=False, index=False)
        if is_one:
            text, name = re.sub("(?m)^;+$", "", text), ""
        for block in text_blocks(path, text.encode()):
            yield replace(block, sheet=name)
