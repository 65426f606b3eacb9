"""The scan folder: a user's measurements as plain files, read with every mistake named, and written.

data/README.md describes the format. Lengths are millimetres once read, whatever the folder's units.
"""

import shutil
import stat
from pathlib import Path

import numpy as np
import pandas as pd

from profilecal.geometry.poses import angle_between
from profilecal.scan.conventions import CONVENTIONS, RowError, find_convention, from_rotations, to_rotations
from profilecal.scan.scan import Scan, ScanError
from profilecal.scan.tables import _labels, _line, _numbers, is_file, is_number, read_table, read_toml, shown, toml_text
from profilecal.targets import TARGETS

MEASURED = {
    "profiles": ("x", "z"),
    "points": ("x", "z"),
    "chords": ("x_a", "z_a", "x_b", "z_b"),
    "arcs": ("x", "z", "r"),
}
NOISE = ("profile_mm", "position_mm", "orientation_deg", "group_position_mm", "group_orientation_deg", "steering_mm")
LENGTHS = tuple(dict.fromkeys(name for target in TARGETS.values() for name in target.lengths))
KEYS = {
    "": ("title", "units", "mount", "target", "noise"),
    "target": ("kind", *LENGTHS, "side"),
    "noise": NOISE,
}
SCALE = {"mm": 1.0, "m": 1000.0}
MOUNTS = ("eye-in-hand", "eye-to-hand")
SAME_ORIENTATION_DEG = 0.05  # poses that differ by less form a rotation group
SIZE_MM = (0.5, 1000.0)  # of a target that a profile scanner can see
REACH_MM = (10.0, 20_000.0)  # farthest flange position from the base: a robot's size
FARTHEST_MM = 10_000.0  # from the scanner; no profile scanner sees as far, and some print such numbers for no point
NOISE_RANGE = (1e-6, 100.0)  # mm or degrees


def read_scan(folder) -> Scan:
    """Read and check a scan folder. Raises ScanError."""
    folder = Path(folder)
    try:
        if not stat.S_ISDIR(folder.stat().st_mode):
            raise ScanError(f"{folder}: not a folder")
        header = read_header(folder / "scan.toml")
        scale = SCALE[header["units"]]
        poses = read_poses(folder, scale)
        measured, values = read_measurements(folder, poses["labels"], scale)
        truth_file = folder / "truth.toml"
        truth = read_toml(truth_file) if is_file(truth_file) else {}
    except FileNotFoundError as error:
        raise ScanError(f"{folder}: no such folder") from error
    except OSError as error:
        raise ScanError(f"{error.filename or folder}: {error.strerror or error}") from error

    target = header["target"]
    kind = TARGETS[target["kind"]]
    if measured not in kind.tables:
        expected = " or ".join(kind.tables)
        raise ScanError(f"{folder}: a target of kind {target['kind']!r} needs {expected}, not {measured}")
    side = np.full(len(values), float(target.get("side", 0)))
    if poses["side"] is not None:
        side = np.where(np.isnan(poses["side"]), side, poses["side"])
    group, given = poses["group"], poses["group"] is not None
    return Scan(
        kind=target["kind"],
        labels=poses["labels"],
        R_base_flange=poses["R"],
        T_base_flange=poses["T"],
        measured=measured,
        values=values,
        sizes=tuple(target[name] * scale for name in kind.lengths),
        side=side,
        group=group if given else find_groups(poses["R"]),
        group_given=given,
        noise=header["noise"],
        mount=header["mount"],
        title=header["title"],
        convention=poses["convention"].name,
        truth=truth,
        warnings=(*poses["warnings"], *(exchanged(values) if measured == "profiles" else ())),
    )


def read_header(path: Path) -> dict:
    """scan.toml, checked, with defaults filled in."""
    if not is_file(path):
        raise ScanError(f'{path}: no such file; expected it to name the target: [target] kind = "edge"')
    header = read_toml(path)
    for section, known in KEYS.items():
        entries = header.setdefault(section, {}) if section else header
        if not isinstance(entries, dict):
            raise ScanError(f"{path}: {section} is {shown(entries)}; expected a table [{section}]")
        for key in entries:
            if key not in known:
                where = f" in [{section}]" if section else ""
                raise ScanError(f"{path}: unknown entry {shown(key)}{where}; there are {', '.join(known)}")
    header = {"title": "", "units": "mm", "mount": "eye-in-hand"} | header
    target = header["target"]
    for name, value, choices in (
        ("units", header["units"], tuple(SCALE)),
        ("mount", header["mount"], MOUNTS),
        ("target kind", target.get("kind"), tuple(TARGETS)),
        ("target side", target.get("side", 1), (1, -1)),
    ):
        if value not in choices or isinstance(value, bool):
            raise ScanError(f"{path}: {name} is {shown(value)}; expected {' or '.join(map(str, choices))}")
    for name, value in header["noise"].items():
        low, high = NOISE_RANGE
        if not is_number(value) or not (value == 0 or low <= value <= high):
            raise ScanError(f"{path}: noise {name} is {shown(value)}; expected zero, or {low:g} to {high:g}")
    title = header["title"]
    if not isinstance(title, str) or not title.isprintable() or len(title) > 200:
        raise ScanError(f"{path}: title is {shown(title)}; expected one line of text")
    _check_sizes(path, target, SCALE[header["units"]])
    return header


def _check_sizes(path: Path, target: dict, scale: float) -> None:
    """Raise ScanError unless a target has its lengths, and no others."""
    kind = target["kind"]
    low, high = (v / scale for v in SIZE_MM)
    for name in LENGTHS:
        value = target.get(name)
        if name not in TARGETS[kind].lengths:
            if value is not None:
                raise ScanError(f"{path}: a target of kind {kind!r} has no {name}; leave it out")
        elif value is None:
            raise ScanError(f"{path}: the {kind}'s {name} is missing; expected {name} = … under [target]")
        elif not is_number(value) or not low <= value <= high:
            raise ScanError(f"{path}: {name} is {shown(value)}; expected {low:g} to {high:g} in the folder's units")


def read_poses(folder: Path, scale: float) -> dict:
    """poses.csv or poses.parquet: labels, R, T in mm, group and side where given, convention, warnings."""
    path, table = read_table(folder, "poses", ("pose", "x", "y", "z"))
    labels = _labels(path, table)
    repeated = pd.Series(labels)[pd.Series(labels).duplicated()]
    if len(repeated):
        raise ScanError(f"{_line(path, table, repeated.index[0])}: pose {shown(repeated.iloc[0])} is there twice")
    with np.errstate(over="ignore"):
        T = _numbers(path, table, ("x", "y", "z")) * scale
        reach = np.linalg.norm(T, axis=1)
    try:
        convention = find_convention(table.columns)
        block = _numbers(path, table, convention.columns)
        R = to_rotations(convention, block)
    except RowError as error:
        raise ScanError(f"{_line(path, table, error.row)}: {error}") from error
    except ScanError:
        raise
    except ValueError as error:
        raise ScanError(f"{path}: {error}") from error

    row = int(np.argmax(reach))
    if not REACH_MM[0] <= reach[row] <= REACH_MM[1]:
        raise ScanError(
            f"{_line(path, table, row)}: the farthest flange position, of pose {shown(labels[row])}, is "
            f"{reach[row]:.3g} mm from the base; expected a robot's size, {REACH_MM[0]:g} to {REACH_MM[1]:g} mm: "
            "are the units in scan.toml right?"
        )
    doubts = []
    if convention.sequence and np.abs(block).max() <= 2 * np.pi:
        names = ", ".join(convention.columns)
        doubts.append(f"{path.name}: all angles {names} lie within ±2π; the columns mean degrees, are they radians?")
    side = _numbers(path, table, ("side",), blank=True)[:, 0] if "side" in table else None
    if side is not None and not np.isin(side[~np.isnan(side)], (-1, 1)).all():
        row = int(np.flatnonzero(~np.isnan(side) & ~np.isin(side, (-1, 1)))[0])
        raise ScanError(f"{_line(path, table, row)}: side is {side[row]:g}; expected 1 or -1")
    group = None
    if "group" in table:
        group = np.unique(table["group"].astype(str).to_numpy(), return_inverse=True)[1]
        _check_groups(path, R, group, labels)
    return {
        "labels": tuple(labels),
        "R": R,
        "T": T,
        "group": group,
        "side": side,
        "convention": convention,
        "warnings": doubts,
    }


def exchanged(profiles) -> list[str]:
    """Says so where x of all profiles (k, 2) looks like a depth and z does not: as if the scanner were turned."""
    points = np.concatenate(profiles)
    points = points[np.isfinite(points).all(axis=1) & points.any(axis=1)]
    if not len(points):
        return []
    (x, z), (x_most, z_most) = points.min(axis=0), points.max(axis=0)
    away = x * x_most > 0 and min(abs(x), abs(x_most)) > (x_most - x) / 10  # x may begin at 0
    if away and z < 0 < z_most:
        return [f"x of the profiles runs from {x:.3g} to {x_most:.3g} mm, as a depth does; are x and z exchanged?"]
    return []


def _check_groups(path, R, group, labels):
    for label in np.unique(group):
        rows = np.flatnonzero(group == label)
        apart = np.degrees(angle_between(R[rows], R[rows[0]]))
        if apart.max() > 1:
            other = labels[rows[np.argmax(apart)]]
            raise ScanError(
                f"{path}: poses {shown(labels[rows[0]])} and {shown(other)} share a group but differ in orientation by "
                f"{apart.max():.2g}°; expected one orientation in a group"
            )


def read_measurements(folder: Path, labels, scale: float) -> tuple[str, tuple[np.ndarray, ...]]:
    """What the scanner saw: which of the four files there is, and its rows in mm by pose."""
    there = [name for name in MEASURED if any([is_file(folder / f"{name}{end}") for end in (".csv", ".parquet")])]
    if len(there) != 1:
        found = f"found {' and '.join(there)}" if there else "found none of them"
        raise ScanError(f"{folder}: expected one of profiles, points, chords, arcs (.csv or .parquet); {found}")
    (measured,) = there
    path, table = read_table(folder, measured, ("pose", *MEASURED[measured]))
    seen = _labels(path, table)
    rows = pd.Index(labels).get_indexer(seen)
    if (rows < 0).any():
        row = int(np.argmax(rows < 0))
        raise ScanError(f"{_line(path, table, row)}: pose {shown(seen[row])} is not in poses")
    numbers = _numbers(path, table, MEASURED[measured], blank=True, largest=FARTHEST_MM / scale) * scale
    order = np.argsort(rows, kind="stable")
    parts = np.split(numbers[order], np.searchsorted(rows[order], np.arange(1, len(labels))))
    for label, part in zip(labels, parts, strict=True):
        if measured != "profiles" and len(part) > 1:
            raise ScanError(f"{path}: pose {shown(label)} has more than one {measured[:-1]}; expected one")
        if measured == "profiles" and len(part) == 1:
            row = int(np.flatnonzero(seen == label)[0])
            raise ScanError(
                f"{_line(path, table, row)}: pose {shown(label)} has a single point; expected a whole profile, or none "
                "where the scanner saw nothing (single sensed points belong into points.csv)"
            )
    largest = np.nanmax(np.abs(numbers), initial=0.0)
    if 0 < largest < 1:
        raise ScanError(f"{path}: no value is larger than {largest:.3g} mm; are the units in scan.toml right?")
    return measured, tuple(parts)


def find_groups(R_base_flange) -> np.ndarray:
    """Rotation groups (P,) from orientations (P, 3, 3): poses within 0.05° of a group's first pose join it."""
    group, firsts = np.empty(len(R_base_flange), dtype=int), []
    for k, R in enumerate(R_base_flange):
        near = [g for g, first in enumerate(firsts) if np.degrees(angle_between(R, first)) < SAME_ORIENTATION_DEG]
        if not near:
            firsts.append(R)
        group[k] = near[0] if near else len(firsts) - 1
    return group


def write_scan(scan: Scan, folder, table: str = ".csv") -> None:
    """Write a scan as a folder of its own, in mm; `table` is ".csv" or ".parquet". Raises ScanError if it is taken."""
    folder = Path(folder)
    if folder.exists() and any(folder.iterdir()):
        raise ScanError(f"{folder}: not empty; name a new folder")
    convention = next(c for c in CONVENTIONS if c.name == scan.convention)
    block = from_rotations(convention, scan.R_base_flange)
    poses = pd.DataFrame({"pose": scan.labels} | dict(zip("xyz", scan.T_base_flange.T, strict=True)))
    poses[list(convention.columns)] = block
    if scan.group_given:
        poses["group"] = scan.group
    if scan.side is not None and np.any(scan.side):
        poses["side"] = scan.side.astype(int)
    counts = [len(rows) for rows in scan.values]
    values = pd.DataFrame(np.concatenate(scan.values), columns=MEASURED[scan.measured])
    values.insert(0, "pose", np.repeat(scan.labels, counts))

    partial = folder.with_name(f".{folder.name}.partial")
    shutil.rmtree(partial, ignore_errors=True)
    try:
        partial.mkdir(parents=True)
    except OSError as error:
        raise ScanError(f"{folder}: cannot be written there: {error.strerror}") from error
    (partial / "scan.toml").write_text(header_text(scan), encoding="utf-8")
    for name, frame in (("poses", poses), (scan.measured, values)):
        path = partial / f"{name}{table}"
        if table == ".csv":
            frame.to_csv(path, index=False, float_format="%.12g")
        else:
            frame.to_parquet(path, index=False)
    if scan.truth:
        (partial / "truth.toml").write_text(toml_text(scan.truth), encoding="utf-8")
    partial.replace(folder)


def header_text(scan: Scan) -> str:
    """scan.toml of a scan."""
    target = {"kind": scan.kind} | scan.measures
    return toml_text({"title": scan.title, "units": "mm", "mount": scan.mount, "target": target, "noise": scan.noise})
