"""Arrays in files of NumPy's and MATLAB's."""

import re
from collections.abc import Sequence
from pathlib import Path
from tokenize import TokenError
from zipfile import BadZipFile

import numpy as np
from numpy import ndarray
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from profilecal.scan.tables import ScanError, Table, naming
from profilecal_tool.importing.makers import renamed
from profilecal_tool.importing.tables import ROW, chosen, from_rows, lines_of, words_in

ENDINGS = (".npy", ".npz", ".mat")
MOST = 16  # numbers of a pose
# all but the points of a PLY or PCD file
CLOUD = re.compile(
    rb"(?s)(?:ply\b.*?\nelement .*?\nend_header|(?:#|VERSION).*?\nDATA \w+)[^\n]*\n"
)
PLY_TYPES = renamed(
    "char=i1 short=i2 int=i4 float=f4 double=f8 uchar=u1 ushort=u2 uint=u4 "
    "float32=f4 float64=f8 uint8=u1 int32=i4"
)
# what NumPy raises on a file that is cut short or changed, beside ValueError
UNREADABLE = (
    EOFError,
    BadZipFile,
    KeyError,
    NotImplementedError,
    TokenError,
    TypeError,
    MatReadError,
)


def arrays_in(path: Path) -> dict[str, ndarray]:
    """The arrays of numbers in a file, by name. Raises ScanError."""
    is_matlab = path.suffix.lower() == ".mat"
    with naming(path), path.open("rb") as file:
        try:
            content = loadmat(file) if is_matlab else np.load(file, allow_pickle=False)
            if isinstance(content, ndarray):
                return {"": np.asarray(content, float)}
            arrays = {name: np.asarray(content[name]) for name in content}
        except UNREADABLE as error:
            raise ScanError(f"{path}: not an array of numbers ({error})") from error
    return {
        name: firsts_first(values.astype(float)) if is_matlab else values
        for name, values in arrays.items()
        if values.dtype.kind in "iuf" and values.size
    }


def vertices_in(path: Path) -> Table | None:
    """The vertices in a PLY or PCD file, without columns where there are none; None in
    another. Raises ScanError.
    """
    if path.suffix.lower() not in (".ply", ".pcd"):
        return None
    with naming(path):
        content = path.read_bytes()
    if not (head := CLOUD.match(content)):
        return None
    lines = head[0].decode("latin-1")
    said = dict(re.findall(r"^(\w+) +(.*\S)", lines, re.MULTILINE))
    form = said.get("format") or said["DATA"]
    order = "<>"["big" in form]
    if "FIELDS" in said:
        names, *kinds = (
            said.get(key, "").lower().split() for key in ("FIELDS", "TYPE", "SIZE")
        )
        kinds = map("".join, zip(*kinds, strict=False))
        count = said.get("POINTS") if {*said.get("COUNT", "")} <= {*"1 "} else ""
    else:
        vertex = re.split(r"\nelement \w+ ", lines)[1]
        count = vertex.partition("\n")[0]
        pairs = re.findall(r"\nproperty\s+(\w+)\s+(\w+)", vertex)
        names = [name for _, name in pairs]
        kinds = [PLY_TYPES.get(kind, kind) for kind, _ in pairs]
    if form == "binary_compressed":
        raise ScanError(f"{path}: compressed; save it as DATA binary or ascii")
    if form.startswith("ascii"):
        text = " ".join(names) + lines.count("\n") * "\n"
        text += content[head.end() :].decode("latin-1")
        return from_rows(path, lines_of(text))
    try:
        parts = [(name, order + kind) for name, kind in zip(names, kinds, strict=True)]
        rows = np.frombuffer(content, np.dtype(parts), int(count), head.end())
    except (TypeError, ValueError) as error:
        raise ScanError(f"{path}: not the points of a PLY or PCD file") from error
    values = np.array([rows[name] for name in names], float)
    return from_array(path, values.T, names if len(rows) else ())


def firsts_first(values: ndarray) -> ndarray:
    """An array of MATLAB's with what its last axis counts, poses or profiles, first."""
    if values.ndim == 3 and values.shape[1] < 5 <= values.shape[2]:
        return np.moveaxis(values, -1, 0)
    return values


def are_poses(values: ndarray) -> bool:
    """Whether an array has a pose, or a part of one, in each row."""
    return values.ndim > 1 and values[0].size <= MOST and values.shape[-1] != 2


def points_in_array(path: Path, entry: str, count: int) -> Table:
    """The points in an array (n, k), or (P, n, k) of several profiles, or turned, for
    `count` poses: the one that is named, or that a file has beside poses.

    Raises ScanError.
    """
    arrays = arrays_in(path)
    axes = [[name for name in arrays if axis in words_in(name)] for axis in "xz"]
    if [*map(len, axes)] == [1, 1] and not entry:
        x, z = (arrays[name] for (name,) in axes)
        arrays = {"": np.stack(np.broadcast_arrays(x, z), axis=-1)}
    called = [name for name in arrays if "profile" in name.lower()]
    others = [name for name, one in arrays.items() if not are_poses(one)]
    alone = next((names for names in (called, others) if len(names) == 1), arrays)
    values = arrays[chosen(path, arrays if entry else alone, entry)]
    if values.ndim not in (2, 3) or not values.size:
        raise ScanError(
            f"{path}: an array of shape {values.shape}; "
            "expected a row for each point or pose"
        )
    if values.ndim == 3 and len(values) != count == values.shape[1]:
        values = values.swapaxes(0, 1)
    if values.shape[-2] <= 3 < values.shape[-1]:
        values = values.mT
    table = from_array(path, values.reshape(-1, values.shape[-1]))
    if values.ndim == 3:
        table.columns[ROW] = np.repeat(np.arange(len(values)), values.shape[1])
    return table


def from_array(path: Path, values: ndarray, names: Sequence[str] = ()) -> Table:
    """The table in an array (n, k); columns without names are called "1", "2", …"""
    names = names or [*map(str, range(1, values.shape[-1] + 1))]
    columns = dict(zip(names, values.T, strict=True))
    rows = range(1, len(values) + 1)
    return Table(path, columns, rows, "row", dict.fromkeys(columns, ""))
