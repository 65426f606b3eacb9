"""Arrays of NumPy, MATLAB and PLY, sheets."""

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
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
    try:
        if path.suffix == ".mat":
            from scipy.io import loadmat

            content = loadmat(path, appendmat=False, squeeze_me=True)
            arrays = {k: np.asarray(a) for k, a in content.items() if k[0] != "_"}
            for name, array in arrays.items():
                if array.ndim == 3:  # MATLAB stacks matrices along the last axis
                    arrays[name] = np.moveaxis(array, -1, 0)
        elif path.suffix == ".ply":
            from plyfile import PlyData

            points = PlyData.read(path)["vertex"].data
            arrays = {name: points[name] for name in points.dtype.names}
        else:
            with path.open("rb") as file:
                loaded = np.load(file, allow_pickle=False)
                arrays = {"": loaded} if isinstance(loaded, ndarray) else {**loaded}
    except Exception as error:  # each reader has its own
        raise ScanError(f"{path}: no arrays of numbers: is it cut short?") from error
    yield from array_blocks(path, arrays)


def array_blocks(path: Path, arrays: Mapping[str, ndarray]) -> Iterator[Block]:
    """Arrays as tables: those with as many rows are one; points of profiles (n, points,
    2 or 3), or of their transposes, another.
    """
    alike = defaultdict(dict)
    for name, array in arrays.items():
        if array.ndim == 0 or array.size == 0:
            continue
        array = array.astype(array.dtype.newbyteorder("="), copy=False)
        if array.shape == OF_POSES[0]:
            array = array[None]
        columns = {}
        if array.ndim == 3 and array.shape[1:] not in OF_POSES:
            if array.shape[1] in (2, 3):
                array = array.swapaxes(1, 2)
            labels = np.arange(1, len(array) + 1, dtype="i4")
            columns = {"label": labels.repeat(array.shape[1])}
            name, array = "points", array.reshape(-1, array.shape[2])
        if array.ndim == 1:
            columns[name] = array
        else:  # numbered
            for k, column in enumerate(array.reshape(len(array), -1).T, 1):
                columns[f"{name}_{k}".strip("_")] = column
        alike[len(array)][name] = columns
    for count, members in alike.items():
        columns = {title: c for own in members.values() for title, c in own.items()}
        name = min(members) if len(members) == 1 else ""
        table = DataFrame(
            dict(enumerate(columns.values())), range(1, count + 1), copy=False
        )
        yield Block(path, table, [*columns], name=name)


def sheet_blocks(path: Path) -> Iterator[Block]:
    """The tables of a workbook. Raises ScanError."""
    try:
        sheets = read_excel(path, sheet_name=None, header=None)
    except Exception as error:  # of the archive, of its XML, of pandas
        raise ScanError(f"{path}: no workbook: is it damaged?") from error
    for name, cells in sheets.items():
        text = cells.to_csv(sep=";", header=False, index=False)
        text = re.sub("^;+$", "", text, flags=re.MULTILINE)
        yield from text_blocks(path, f"{name}\n{text}".encode())
