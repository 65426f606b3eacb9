"""Files as such: what is there, why one cannot be read, and writing that is whole or leaves nothing."""

import shutil
import stat
from contextlib import contextmanager
from pathlib import Path

from profilecal.scan.scan import ScanError


@contextmanager
def naming(path: Path):
    """What goes wrong in reading a file becomes a ScanError that names it."""
    try:
        yield
    except ScanError:
        raise
    except UnicodeDecodeError as error:
        line, byte = error.object.count(b"\n", 0, error.start) + 1, error.object[error.start : error.start + 1]
        raise ScanError(f"{path}: not UTF-8 text, {byte!r} in line {line}; save it as UTF-8") from error
    except OSError as error:
        raise ScanError(f"{path}: {error.strerror or error}") from error
    except RecursionError as error:
        raise ScanError(f"{path}: nested too deeply") from error
    except ValueError as error:
        raise ScanError(f"{path}: {error}") from error


def text_of(path: Path) -> str:
    """A file's text. Raises ScanError."""
    with naming(path):
        return path.read_bytes().decode("utf-8-sig")


def is_file(path: Path) -> bool:
    """Whether there is a file. Raises ScanError for what is no file, or cannot be told (a loop of links, no right)."""
    with naming(path):
        try:
            mode = path.stat().st_mode
        except FileNotFoundError:
            return False
    if not stat.S_ISREG(mode):
        raise ScanError(f"{path}: not a file")
    return True


@contextmanager
def whole(path: Path):
    """A place beside `path` for a file or a folder that then appears at `path` whole, or after an error not at all."""
    partial = partial_of(path)
    remove(partial)
    try:
        yield partial
        partial.replace(path)
    finally:
        remove(partial)


@contextmanager
def new_folder(path: Path):
    """A folder to fill that then appears at `path` whole. Raises ScanError where something is there, or cannot be."""
    if path.exists() and any(path.iterdir()):
        raise ScanError(f"{path}: not empty; name a new folder")
    with whole(path) as partial:
        try:
            partial.mkdir(parents=True)
        except OSError as error:
            raise ScanError(f"{path}: cannot be written there: {error.strerror}") from error
        yield partial


def partial_of(path: Path) -> Path:
    """Where `whole` has a file while it is being written."""
    return path.parent / f".{path.name}.partial"


def remove(path: Path) -> None:
    """Remove a file or a folder, if it is there."""
    if path.is_dir():
        shutil.rmtree(path)
    elif path.exists():
        path.unlink()
