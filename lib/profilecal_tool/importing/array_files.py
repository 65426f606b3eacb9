"""Arrays of NumPy and MATLAB, point clouds, sheets."""

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray
from pandas import DataFrame, read_excel

from profilecal.scan.tables import ScanError
from profilecal_tool.importing.text_tables import Block, text_blocks, with_continuations

OF_POSES = (4, 4), (3, 4), (3, 3), (3, 1), (1, 3)  # what a pose's matrices have


def arrays_in(path: Path) -> Mapping[str, Any]:
    """The arrays of a file by their names."""
    if path.suffix == ".mat":
        from scipy.io import loadmat

        content = loadmat(path, appendmat=False, squeeze_me=True)
        arrays = {name: one for name, one in content.items() if name[:2] != "__"}
        return {name: stacked_first(array) for name, array in arrays.items()}
    if path.suffix == ".ply":
        from plyfile import PlyData

        points = PlyData.read(path)["vertex"].data
        return {name: points[name] for name in points.dtype.names}
    with path.open("rb") as file:
        loaded = np.load(file, allow_pickle=False)
        return {"": loaded} if isinstance(loaded, ndarray) else {**loaded}


def stacked_first(array: Any) -> ndarray:
    """An array of MATLAB, which stacks matrices along the last axis, as NumPy's."""
    array = np.asarray(array)
    return np.moveaxis(array, -1, 0) if array.ndim == 3 else array


def binary_blocks(path: Path) -> Iterator[Block]:
    """The tables of a file of arrays. Raises ScanError."""
    try:
        arrays = {name: np.asarray(one) for name, one in arrays_in(path).items()}
    except Exception as error:  # each reader has its own
        raise ScanError(f"{path}: no arrays of numbers: is it cut short?") from error
    yield from array_blocks(path, arrays)


def array_blocks(path: Path, arrays: Mapping[str, ndarray]) -> Iterator[Block]:
    """Arrays as tables: those with as many rows are one; points of profiles another."""
    alike = defaultdict(dict)
    for name, array in arrays.items():
        if array.ndim == 0 or array.size == 0:
            continue
        array = array.astype(array.dtype.newbyteorder("="), copy=False)
        if array.shape == OF_POSES[0]:
            array = array[None]
        if array.ndim == 3 and array.shape[1:] not in OF_POSES:
            yield block_of_columns(path, name, columns_of_points(array))
        else:
            alike[len(array)][name] = array
    for members in alike.values():
        columns = {}
        for name, array in members.items():
            columns |= columns_of_array(name, array)
        yield block_of_columns(path, name if len(members) == 1 else "", columns)


def columns_of_points(profiles: ndarray) -> dict[str, ndarray]:
    """The columns of profiles (n, points, 2 or 3), or of their transposes."""
    if profiles.shape[1] in (2, 3):
        profiles = profiles.swapaxes(1, 2)
    count, points, columns = profiles.shape
    label = np.arange(1, count + 1, dtype="i4").repeat(points)
    return {"label": label} | columns_of_array("points", profiles.reshape(-1, columns))


def columns_of_array(name: str, array: ndarray) -> dict[str, ndarray]:
    """The columns of an array, numbered if it may have several."""
    if array.ndim == 1:
        return {name: array}
    columns = array.reshape(len(array), -1).T
    return {f"{name}_{k}".strip("_"): c for k, c in enumerate(columns, 1)}


def block_of_columns(path: Path, name: str, columns: dict[str, ndarray]) -> Block:
    """Columns by their titles as a block."""
    table = DataFrame(columns, copy=False)
    table.index += 1
    return Block(path, table, [*columns], name=name)


def sheet_blocks(path: Path) -> Iterator[Block]:
    """The tables of a workbook. Raises ScanError."""
    try:
        sheets = read_excel(path, sheet_name=None, header=None)
    except Exception as error:  # of the archive, of its XML, of pandas
        raise ScanError(f"{path}: no workbook: is it damaged?") from error
    for name, cells in sheets.items():
        text = cells.to_csv(sep=";", header=False, index=False)
        text = re.sub("^;+$", "", text, flags=re.MULTILINE)
        yield from with_continuations(text_blocks(path, f"{name}\n{text}".encode()))
