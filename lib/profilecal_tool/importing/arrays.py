"""Arrays in files of NumPy's and MATLAB's."""

import re
from collections.abc import Collection, Sequence
from pathlib import Path
from tokenize import TokenError
from zipfile import BadZipFile

import numpy as np
from numpy import ndarray
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from profilecal.scan.tables import ScanError, Table, listed, naming, shown
from profilecal_tool.importing.makers import renamed

ENDINGS = (".npy", ".npz", ".mat")
MOST = 16  # numbers of a pose
BINARY_PLY = re.compile(
    rb"(?s)ply\r?\nformat binary_(\w+)_endian.*?\nelement vertex (\d+)"
    rb"((?:\s+property[^\n]*)*).*?\nend_header\r?\n"
)
BINARY_PCD = re.compile(
    rb"(?s)(?:#|VERSION).*?FIELDS ([^\n]*)\nSIZE ([^\n]*)\nTYPE ([^\n]*)\n"
    rb"(?:COUNT[ 1]*\n)?(?:(?!COUNT|DATA).)*?POINTS (\d+)\s+"
    rb"DATA binary(_compressed)?\r?\n"
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
    with naming(path), path.open("rb") as file:
        try:
            if path.suffix.lower() == ".mat":
                content = loadmat(file)
            else:
                content = np.load(file, allow_pickle=False)
            if isinstance(content, ndarray):
                return {"": np.asarray(content, float)}
            arrays = {name: np.asarray(content[name]) for name in content}
        except UNREADABLE as error:
            raise ScanError(f"{path}: not an array of numbers ({error})") from error
    return {
        name: firsts_first(values.astype(float)) if path.suffix == ".mat" else values
        for name, values in arrays.items()
        if values.dtype.kind in "iuf" and values.size
    }


def vertices_in(path: Path) -> Table | None:
    """The vertices in a binary PLY or PCD file, without columns where there are none;
    None in another.
    """
    with naming(path):
        is_cloud = path.suffix.lower() in (".ply", ".pcd")
        content = path.read_bytes() if is_cloud else b""
        if head := BINARY_PLY.match(content):
            order = "<" if head[1] == b"little" else ">"
            pairs = re.findall(r"property\s+(\w+)\s+(\w+)", head[3].decode())
            kinds = [(name, order + PLY_TYPES.get(kind, kind)) for kind, name in pairs]
            count = head[2]
        elif head := BINARY_PCD.match(content):
            *lines, count, compressed = head.groups()
            if compressed:
                raise ScanError(f"{path}: compressed; save it as DATA binary or ascii")
            parts = zip(*(line.decode().lower().split() for line in lines), strict=True)
            kinds = [(name, f"<{kind}{size}") for name, size, kind in parts]
        else:
            return None
        try:
            rows = np.frombuffer(content, np.dtype(kinds), int(count), head.end())
        except TypeError as error:
            raise ScanError(f"{path}: not the points of a PLY or PCD file") from error
        names = rows.dtype.names if len(rows) else ()
        values = np.array([rows[name] for name in names], float)
        return from_array(path, values.T, names)


def firsts_first(values: ndarray) -> ndarray:
    """An array of MATLAB's with what its last axis counts, poses or profiles, first."""
    if values.ndim == 3 and values.shape[1] < 5 <= values.shape[2]:
        return np.moveaxis(values, -1, 0)
    return values


def are_poses(values: ndarray) -> bool:
    """Whether an array has a pose, or a part of one, in each row."""
    return values.ndim > 1 and values[0].size <= MOST and values.shape[-1] != 2


def point_array(path: Path, entry: str = "") -> ndarray:
    """The points in an array of two or three axes: the one that is named, or that a
    file has beside poses. Raises ScanError.
    """
    arrays = arrays_in(path)
    if {"x", "z"} <= arrays.keys() and not entry:
        return np.stack(np.broadcast_arrays(arrays["x"], arrays["z"]), axis=-1)
    called = [name for name in arrays if "profile" in name.lower()]
    beside = [name for name, one in arrays.items() if not are_poses(one)]
    alone = next((names for names in (called, beside) if len(names) == 1), arrays)
    values = arrays[chosen(path, arrays if entry else alone, entry)]
    if values.ndim not in (2, 3) or not values.size:
        raise ScanError(
            f"{path}: an array of shape {values.shape}; "
            "expected a row for each point or pose"
        )
    return values


def from_array(path: Path, values: ndarray, names: Sequence[str] = ()) -> Table:
    """The table in an array (n, k); columns without names are called "1", "2", …"""
    names = names or [*map(str, range(1, values.shape[-1] + 1))]
    columns = dict(zip(names, values.T, strict=True))
    rows = range(1, len(values) + 1)
    return Table(path, columns, rows, "row", dict.fromkeys(columns, ""))


def chosen(path: Path, lists: Collection[str], entry: str) -> str:
    """The name of one of several lists. Raises ScanError where that is not clear."""
    name = entry or (next(iter(lists)) if len(lists) == 1 else "profile")
    if name not in lists:
        raise ScanError(
            f"{path}: no list {shown(name)}; "
            f"there are {listed(lists) or 'none'} (--entry)"
        )
    return name
