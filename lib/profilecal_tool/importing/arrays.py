"""Arrays of NumPy and MATLAB, point clouds, sheets."""

from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray
from pandas import DataFrame, read_excel

from profilecal.scan.tables import ScanError, naming
from profilecal_tool.importing.blocks import Block, text_blocks

OF_POSES = (4, 4), (3, 4), (3, 3), (3, 1), (1, 3)  # what a pose's matrices have


def arrays_in(path: Path) -> Mapping[str, Any]:
    """The arrays of a file by their names."""
    if path.suffix == ".mat":
        from scipy.io import loadmat

        content = loadmat(path, appendmat=False, squeeze_me=True)
        arrays = {name: one for name, one in content.items() if name[:2] != "__"}
        for name, array in arrays.items():  # MATLAB stacks along the last axis
            arrays[name] = np.moveaxis(array, -1, 0) if array.ndim == 3 else array
        return arrays
    if path.suffix == ".ply":
        from plyfile import PlyData

        points = PlyData.read(path)["vertex"].data
        return {name: points[name] for name in points.dtype.names}
    with path.open("rb") as file:
        loaded = np.load(file, allow_pickle=False)
        return {"": loaded} if isinstance(loaded, ndarray) else {**loaded}


def binary_blocks(path: Path) -> Iterator[Block]:
    """The tables of a file of arrays. Raises ScanError."""
    try:
        arrays = {name: np.asarray(one) for name, one in arrays_in(path).items()}
    except Exception as error:  # each reader has its own
        raise ScanError(f"{path}: no arrays of numbers: is it cut short?") from error
    yield from array_blocks(path, arrays)


def array_blocks(path: Path, arrays: Mapping[str, ndarray]) -> Iterator[Block]:
    """Arrays as tables: those with as many rows are one; points of profiles another."""
    tables, names = defaultdict(dict), {}
    for name, array in arrays.items():
        if array.ndim == 0 or array.dtype.kind not in "fiub":
            continue
        array = array.astype(array.dtype.newbyteorder("="), copy=False)
        if array.shape == OF_POSES[0]:
            array = array[None]
        key = len(array)
        if array.ndim == 3 and array.shape[1:] not in OF_POSES:
            if array.shape[1] in (2, 3):
                array = array.swapaxes(1, 2)
            count, each, columns = array.shape
            tables[name]["label"] = np.arange(1, count + 1, dtype="i4").repeat(each)
            key, name, array = name, "points", array.reshape(-1, columns)
        names[key] = "" if key in names else name
        if array.ndim == 1:
            tables[key][name] = array
        else:
            flat = array.reshape(len(array), -1)
            named = {f"{name}_{k}": column for k, column in enumerate(flat.T, 1)}
            tables[key] |= named
    for name, table in tables.items():
        titles = [title.removeprefix("_") for title in table]
        rows = DataFrame(table, copy=False)
        rows.index += 1
        yield Block(path, rows, titles, name=name if name in arrays else names[name])


def sheets(path: Path) -> Iterator[Block]:
    """The tables of a workbook."""
    with naming(path):
        for name, cells in read_excel(path, sheet_name=None, header=None).items():
            text = cells.to_csv(sep=";", header=False, index=False)
            yield from text_blocks(path, f"{name}\n{text}".encode())
