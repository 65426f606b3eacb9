"""Arrays in NumPy's files."""

from collections.abc import Collection
from pathlib import Path
from tokenize import TokenError
from zipfile import BadZipFile

import numpy as np
from numpy import ndarray

from profilecal.scan.tables import ScanError, Table, listed, naming, shown

ENDINGS = (".npy", ".npz")
# what NumPy raises on a file that is cut short or changed, beside ValueError
UNREADABLE = (
    EOFError,
    BadZipFile,
    KeyError,
    NotImplementedError,
    TokenError,
    TypeError,
)


def array(path: Path, entry: str = "") -> ndarray:
    """The numbers of an array of two or three axes, or of one in an archive.

    Raises ScanError.
    """
    with naming(path), path.open("rb") as file:
        try:
            content = np.load(file, allow_pickle=False)
            if not isinstance(content, ndarray):
                content = content[chosen(path, content, entry)]
            values = np.asarray(content, float)
        except UNREADABLE as error:
            raise ScanError(f"{path}: not an array of numbers ({error})") from error
    if values.ndim not in (2, 3) or not values.size:
        raise ScanError(
            f"{path}: an array of shape {values.shape}; "
            "expected a row for each point or pose"
        )
    return values


def from_array(path: Path, values: ndarray) -> Table:
    """The table in an array (n, k); its columns are called "1", "2", …"""
    columns = {str(k): column for k, column in enumerate(values.T, 1)}
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
