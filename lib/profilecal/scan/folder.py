"""Scan folders, as data/README.md describes them: read with every mistake named, and
written. Lengths become mm.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray

from profilecal.geometry.checks import REACH_MM
from profilecal.geometry.log import Log
from profilecal.geometry.poses import rotation_groups
from profilecal.scan.conventions import (
    find_convention,
    from_rotations,
    named,
    pose_matrices,
    to_rotations,
)
from profilecal.scan.motion import checked_log, moment_label, with_motion
from profilecal.scan.scan import (
    FARTHEST_MM,
    GUESS_SD,
    MEASURED,
    MOUNTS,
    NOISE,
    Scan,
    length_rules,
)
from profilecal.scan.tables import (
    ScanError,
    Table,
    is_file,
    listed,
    naming,
    new_folder,
    read_parts,
    read_table,
    write_table,
)
from profilecal.scan.toml import (
    TABLE,
    TEXT,
    Rule,
    check_entries,
    number,
    numbers,
    one_of,
    read_toml,
    toml_text,
)
from profilecal.targets import TARGETS

SCALE = {"mm": 1.0, "m": 1000.0}
SPREADSHEET = 1_000_000  # rows that people can look at: more become arrays
DEFAULTS = {"title": "", "units": "mm", "mount": MOUNTS[0], "target": {}, "noise": {}}
DEFAULTS |= {"motion": {}, "guess": {}}
# of a scan's sensor: X Y Z mm, W P R degrees, R = Rz(R) Ry(P) Rx(W)
GUESS: dict[str, Rule] = {
    "mount": numbers(6),
    "sd_mm": number(1e-3, 1000),
    "sd_deg": number(1e-3, 180),
}
NO_POSES: dict[str, Any] = {
    "labels": (),
    "R_base_flange": np.empty((0, 3, 3)),
    "p_base_flange": np.empty((0, 3)),
    "group": np.array([]),
    "side": np.array([]),
    "times": np.array([]),
}


def read_scan(folder: str | Path) -> Scan:
    """Read and check a scan folder.

    Parameters
    ----------
    folder : str or Path
        A folder with scan.toml, poses.csv and what the scanner saw, as data/README.md
        describes it.

    Returns
    -------
    Scan
        The measurements, lengths in mm.

    Raises
    ------
    ScanError
        Where something is wrong: one sentence with the file, the row, the value and
        what was expected.

    See Also
    --------
    Scan.of : the same from arrays in memory.
    write_scan : the way back.

    Examples
    --------
    >>> import profilecal as pc
    >>> from tempfile import TemporaryDirectory
    >>> scan, truth = pc.simulate("ball", seed=1)
    >>> with TemporaryDirectory() as place:
    ...     pc.write_scan(scan, f"{place}/scan")
    ...     again = pc.read_scan(f"{place}/scan")
    >>> again
    Scan(ball, radius 25 mm, 40 poses of 10 orientations, arcs, eye-in-hand)
    """
    folder = Path(folder)
    if not folder.exists():
        raise ScanError(f"{folder}: no such folder")
    if folder.is_file():
        raise ScanError(f"{folder} is a file; expected a scan folder")
    header = read_header(folder / "scan.toml")
    scale = SCALE[header["units"]]
    side = header["target"].get("side", 0)
    log = None
    if is_file(folder / "log.csv"):
        log, convention = read_log(folder / "log.csv", scale)
        poses = NO_POSES | {"convention": convention}
    if log is None or is_file(folder / "poses.csv"):
        poses = read_poses(folder / "poses.csv", scale, side)
    at_rest = poses["times"] if log is None else np.full(len(poses["labels"]), np.nan)
    seen = {label: ("", t) for label, t in zip(poses["labels"], at_rest, strict=True)}
    measured, values = read_measurements(folder, seen, scale, log is not None)
    sweeps, times = zip(*seen.values(), strict=True)
    if log is None:
        poses["times"] = np.array(times)
    else:
        sides = np.full(len(seen), float(side))
        sides[: len(poses["labels"])] = poses["side"]
        poses = {
            **with_motion(log, times, sweeps, poses),
            "side": sides,
            "convention": poses["convention"],
            "delay_ms": header["motion"].get("delay_ms"),
        }
    return scan_of(folder, header, poses, measured, values)


def read_log(path: Path, scale: float) -> tuple[Log, str]:
    """The poses that the robot recorded on its way, positions in units of `scale` mm,
    and the name of their convention.

    Raises ScanError.
    """
    table = read_table(path, ("t", "x", "y", "z"))
    t = table.numbers(("t",))[:, 0]
    earlier = np.diff(t, prepend=-np.inf) <= 0
    table.refuse(earlier, "t is {:.12g}, not later than in the row before", t)
    positions = checked_positions(table, scale, t)
    with naming(path):
        convention = find_convention(table.columns)
        block = table.numbers(convention.columns)
        rotations = to_rotations(convention, block, table)
        return checked_log(t, rotations, positions), convention.name


def scan_of(
    folder: Path,
    header: dict[str, Any],
    poses: dict[str, Any],
    measured: str,
    values: Sequence[ndarray],
) -> Scan:
    """The scan of a checked header, entries of a Scan, and rows in mm by pose."""
    target = header["target"]
    kind, scale = target["kind"], SCALE[header["units"]]
    try:
        return Scan(
            kind=kind,
            measured=measured,
            values=tuple(values),
            sizes=tuple(target[name] * scale for name in TARGETS[kind].lengths),
            noise=header["noise"],
            mount=header["mount"],
            title=header["title"],
            **guess_of(header["guess"]),
            **poses,
        )
    except ScanError as error:
        raise ScanError(f"{folder}: {error}") from error


def guess_of(said: dict[str, Any]) -> dict[str, Any]:
    """The table [guess]: entries of a Scan."""
    if "mount" not in said:
        return {}
    sd = said.get("sd_mm", GUESS_SD[0]), said.get("sd_deg", GUESS_SD[1])
    return {"guess": mount_pose(said["mount"]), "guess_sd": sd}


def mount_pose(numbers: Sequence[float]) -> ndarray:
    """The pose (4, 4) of X Y Z mm, W P R degrees."""
    position, angles = np.reshape(numbers, (2, 1, 3))
    return pose_matrices(position, angles, "FANUC angles")[0]


def read_header(path: Path) -> dict[str, Any]:
    """scan.toml, checked, with defaults filled in."""
    if not is_file(path):
        raise ScanError(
            f"{path}: no such file; expected it to name the target: "
            '[target] kind = "edge" (other files: profilecal import)'
        )
    return check_header(path, read_toml(path))


def check_header(path: Path, header: dict[str, Any]) -> dict[str, Any]:
    """What such a file says, checked, with defaults filled in; errors name `path`.

    Raises ScanError.
    """
    header = DEFAULTS | header
    rules = {
        "title": TEXT,
        "units": one_of(SCALE),
        "mount": one_of(MOUNTS),
        "target": TABLE,
        "noise": NOISE,
        "motion": {"delay_ms": number(-200, 200)},
        "guess": GUESS,
    }
    check_entries(path, header, rules)
    target = header["target"]
    kind = target.get("kind")
    check_entries(path, {"kind": kind}, {"kind": one_of(TARGETS)}, "target")
    lengths = length_rules(kind, SCALE[header["units"]])
    of_target = {"kind": TEXT, "side": one_of((1, -1))} | lengths
    check_entries(path, target, of_target, "target", needed=lengths)
    return header


def read_poses(path: Path, scale: float, side: int = 0) -> dict[str, Any]:
    """What a table of poses, in units of `scale` mm, says: entries of a Scan.

    `side` is that of poses for which the table says none. Raises ScanError.
    """
    return check_poses(read_table(path, ("pose", "x", "y", "z")), scale, side)


def check_poses(table: Table, scale: float, side: int = 0) -> dict[str, Any]:
    """The same of a table that has been read."""
    labels = table.labels()
    first, row = np.unique(labels, return_index=True, return_inverse=True)[1:]
    table.refuse(first[row] < np.arange(len(labels)), "pose {} is there twice", labels)
    positions = checked_positions(table, scale, labels)
    with naming(table.path):
        convention = find_convention(table.columns)
        block = table.numbers(convention.columns)
        rotations = to_rotations(convention, block, table)
    group, given = groups_of(table, rotations)
    times = table.times()
    if "t" in convention.columns:  # an angle
        times = np.full(len(labels), np.nan)
    return {
        "labels": tuple(labels),
        "R_base_flange": rotations,
        "p_base_flange": positions,
        "side": sides_of(table, side),
        "group": group,
        "group_given": given,
        "convention": convention.name,
        "orientation": block,
        "times": times,
    }


def checked_positions(table: Table, scale: float, labels: ndarray) -> ndarray:
    """The flange's positions (P, 3), mm, no farther from the base than robots reach."""
    with np.errstate(over="ignore"):
        positions = table.numbers(("x", "y", "z")) * scale
        reach = np.linalg.norm(positions, axis=1)
    low, high = REACH_MM
    farthest = reach.max()
    wrong = (reach == farthest) & ~(low <= farthest <= high)
    table.refuse(
        wrong,
        "the farthest flange position, of pose {}, is {:.3g} mm from the base; "
        f"expected a robot's size, {low:g} to {high:g} mm: are the units right?",
        labels,
        reach,
    )
    return positions


def sides_of(table: Table, side: int) -> ndarray:
    """The column `side` (P,), or `side` where it says nothing."""
    if "side" not in table.columns:
        return np.full(len(table.lines), float(side))
    sides = table.numbers(("side",), blank=True)[:, 0]
    sides[np.isnan(sides)] = side
    known = np.isin(sides, (-1, 0, 1))
    table.refuse(~known, "side is {:g}; expected 1 or -1", sides)
    return sides


def groups_of(table: Table, rotations: ndarray) -> tuple[ndarray, bool]:
    """Numbers of the rotation groups (P,), and whether the table states them."""
    cells = [str(cell).strip() for cell in table.columns.get("group", ())]
    if not any(cells):
        return rotation_groups(rotations), False
    blank = [not cell for cell in cells]
    table.refuse(blank, "no group; expected one for each pose, or for none")
    return np.unique(cells, return_inverse=True)[1], True


def read_measurements(
    folder: Path, seen: dict[str, tuple[str, float]], scale: float, moving: bool
) -> tuple[str, tuple[ndarray, ...]]:
    """What the scanner saw: which of the four tables there is, and its rows in mm by
    pose. `seen`: of each label the sweep and the time; those in motion are added.
    """
    ways = (folder / f"{name}{kind}" for name in MEASURED for kind in (".csv", ".npz"))
    paths = [path for path in ways if is_file(path)]
    if len(paths) != 1:
        found = " and ".join(path.name for path in paths) or "none of them"
        names = f"{listed(MEASURED)} (.csv, .npz)"
        raise ScanError(f"{folder}: expected one of {names}; found {found}")
    (path,) = paths
    columns = MEASURED[path.stem]
    most = FARTHEST_MM / scale
    at_rest = ["pose"] * bool(seen or not moving)
    keys = [*at_rest, *(["sweep", "t"] * moving)]
    known = {label: pose for pose, label in enumerate(seen)}
    parts = []
    for table in read_parts(path, (*keys, *columns)):
        if moving:
            table = with_labels(table, seen)
            known |= {label: k for k, label in enumerate(seen) if k >= len(known)}
        labels = table.labels()
        pose = np.array([known.get(label, -1) for label in labels])
        table.refuse(pose < 0, "pose {} is not in poses", labels)
        if not moving and "t" in table.columns:
            of_rows = zip(labels, table.times(), strict=True)
            seen |= {label: ("", t) for label, t in of_rows}
        numbers = table.numbers(columns, blank=True, largest=most) * scale
        parts.append((table.lines, pose, numbers))
    lines, pose, numbers = map(np.concatenate, zip(*parts, strict=True))
    counts = np.bincount(pose, minlength=len(seen))
    check_counts(replace(table, lines=lines), path.stem, [*seen], pose, counts)
    largest = np.nanmax(np.abs(numbers), initial=0.0)
    if 0 < largest < 1:
        raise ScanError(
            f"{path}: no value is larger than {largest:.3g} mm; "
            "are the units in scan.toml right?"
        )
    by_pose = numbers[np.argsort(pose, kind="stable")]
    return path.stem, tuple(np.split(by_pose, np.cumsum(counts)[:-1]))


def with_labels(table: Table, seen: dict[str, tuple[str, float]]) -> Table:
    """The table with a label in each row: its pose, or its sweep and time, which `seen`
    gets to know.
    """
    sweeps = [str(cell).strip() for cell in table.columns["sweep"]]
    poses = [
        str(cell).strip() for cell in table.columns.get("pose", [""] * len(sweeps))
    ]
    times = table.numbers(("t",), blank=True)[:, 0]
    is_moving = np.isfinite(times) & (np.array(sweeps) != "")
    is_at_rest = np.array(poses) != ""
    table.refuse(
        is_moving == is_at_rest,
        "pose {}, sweep {}, t {:g}; expected either a pose, or a sweep with its t",
        poses,
        sweeps,
        times,
    )
    labels = poses
    for row in np.flatnonzero(is_moving):
        labels[row] = moment_label(sweeps[row], times[row])
        seen[labels[row]] = sweeps[row], float(times[row])
    return replace(table, columns={**table.columns, "pose": labels})


def check_counts(
    table: Table, measured: str, labels: Sequence[str], pose: ndarray, counts: ndarray
) -> None:
    """Refuse a profile of one point, and a pose with two points, chords or arcs."""
    if measured == "profiles":
        wrong = counts == 1
        expected = (
            "more, or none where the scanner saw nothing "
            "(single sensed points belong into points.csv)"
        )
    else:
        wrong = counts > 1
        expected = "one"
    sentence = f"pose {{}} has {{}} rows; expected {expected}"
    label = np.array(labels, dtype=object)[pose]
    table.refuse(wrong[pose], sentence, label, counts[pose])


def poses_columns(
    labels: Sequence | ndarray, R: ndarray, p: ndarray, convention: str
) -> dict[str, Any]:
    """The columns of poses R (P, 3, 3), p (P, 3), mm, with angles in a convention."""
    angles = named(convention)
    block = np.hstack([p, from_rotations(angles, R)])
    names = ("pose", "x", "y", "z", *angles.columns)
    return dict(zip(names, (labels, *block.T), strict=True))


def write_scan(scan: Scan, folder: str | Path) -> None:
    """Write a scan as a new folder of its own, in mm; orientations as they were read.

    Parameters
    ----------
    scan : Scan
        What to write; where it is simulated, its truth goes to truth.toml. More than a
        million rows, which no spreadsheet opens, become an .npz file.
    folder : str or Path
        A folder that is not there yet, or is empty. It appears whole or not at all.

    Raises
    ------
    ScanError
        Where the folder is in use.

    See Also
    --------
    read_scan : the way back, with an example.
    """
    still = ~scan.moving
    labels = np.where(still, scan.labels, "")
    poses = poses_columns(
        labels[still],
        scan.R_base_flange[still],
        scan.p_base_flange[still],
        scan.convention,
    )
    if scan.orientation is not None:  # as read: another convention may be meant
        angles = named(scan.convention).columns
        poses |= zip(angles, scan.orientation.T, strict=True)
    if scan.group_given:
        poses["group"] = scan.group[still]
    if np.any(scan.side[still]):
        poses["side"] = scan.side[still].astype(int)
    keys = {"pose": labels} if still.any() else {}
    if scan.log:
        keys |= {"sweep": np.array(scan.sweeps), "t": scan.times}
    counts = [len(rows) for rows in scan.values]
    repeated = {name: column.repeat(counts) for name, column in keys.items()}
    measurements: dict[str, Any] = repeated
    columns = MEASURED[scan.measured]
    measurements |= zip(columns, np.concatenate(scan.values).T, strict=True)
    header = {
        "title": scan.title,
        "units": "mm",
        "mount": scan.mount,
        "target": {"kind": scan.kind} | scan.measures,
        "noise": dict(scan.noise),
    }
    if scan.delay_ms is not None:
        header["motion"] = {"delay_ms": scan.delay_ms}
    if scan.guess is not None:
        R, p = scan.guess[None, :3, :3], scan.guess[:3, 3]
        mount = [*p.tolist(), *from_rotations(named("FANUC angles"), R)[0].tolist()]
        sd_mm, sd_deg = scan.guess_sd
        header["guess"] = {"mount": mount, "sd_mm": sd_mm, "sd_deg": sd_deg}
    with new_folder(Path(folder)) as partial:
        (partial / "scan.toml").write_text(toml_text(header), encoding="utf-8")
        if still.any():
            write_table(partial / "poses.csv", poses)
        if scan.log:
            t, R, p = scan.log.t, scan.log.R, scan.log.p
            way = poses_columns(t, R, p, scan.convention)
            del way["pose"]
            write_table(partial / "log.csv", {"t": t} | way)
        if sum(counts) > SPREADSHEET:
            np.savez_compressed(partial / f"{scan.measured}.npz", **measurements)
        else:
            write_table(partial / f"{scan.measured}.csv", measurements)
        if scan.truth:
            truth = toml_text(scan.truth)
            (partial / "truth.toml").write_text(truth, encoding="utf-8")
