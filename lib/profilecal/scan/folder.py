"""Scan folders, as data/README.md describes them: read with every mistake named, and
written. Lengths become mm.

Each file says some of the entries that a `Scan` is made of.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray

from profilecal.geometry.checks import FARTHEST_MM, REACH_MM
from profilecal.geometry.poses import homogeneous
from profilecal.scan.conventions import (
    CONVENTIONS,
    find_convention,
    from_rotations,
    named,
    to_rotations,
)
from profilecal.scan.motion import DELAY_MS, checked_log, moment_label
from profilecal.scan.scan import (
    ENTRY_RULES,
    GUESS_SD,
    MEASURED,
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
    Entries,
    check_entries,
    number,
    numbers,
    one_of,
    read_toml,
    toml_text,
)

SCALE = {"mm": 1.0, "m": 1000.0}
SPREADSHEET = 1_000_000  # rows that people can look at: more become arrays
HEADER: dict[str, Any] = {
    "title": ENTRY_RULES["title"],
    "units": one_of(SCALE),
    "mount": ENTRY_RULES["mount"],
    "target": TABLE,
    "noise": ENTRY_RULES["noise"],
    "motion": {"delay_ms": DELAY_MS},
    # where the sensor is: X Y Z mm, W P R degrees, R = Rz(R) Ry(P) Rx(W)
    "guess": {
        "mount": numbers(6),
        "sd_mm": number(1e-3, 1000),
        "sd_deg": number(1e-3, 180),
    },
}
NO_POSES: Entries = {
    "labels": (),
    "R_base_flange": np.empty((0, 3, 3)),
    "p_base_flange": np.empty((0, 3)),
    "side": np.array([]),
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
    header, scale = read_header(folder / "scan.toml")
    log = folder / "log.csv"
    moving = is_file(log)
    at_rest = NO_POSES
    if not moving or is_file(folder / "poses.csv"):
        at_rest = read_poses(folder / "poses.csv", scale, header["side"])
    entries = header | at_rest | read_measurements(folder, at_rest, scale, moving)
    sides = np.full(len(entries["values"]), header["side"])
    sides[: len(at_rest["side"])] = at_rest["side"]
    if moving:  # the log's convention counts, as orientations are by it
        entries |= read_log(log, scale)
    return scan_of(folder, entries | {"side": sides})


def scan_of(folder: Path, entries: Entries) -> Scan:
    """The scan of such entries. Raises ScanError, which names the folder."""
    try:
        return Scan(**entries)
    except ScanError as error:
        raise ScanError(f"{folder}: {error}") from error


def read_header(path: Path) -> tuple[Entries, float]:
    """What scan.toml says, as `check_header` has it."""
    if not is_file(path):
        raise ScanError(
            f"{path}: no such file; expected it to name the target: "
            '[target] kind = "edge" (other files: profilecal import)'
        )
    return check_header(path, read_toml(path))


def check_header(path: Path, said: Entries) -> tuple[Entries, float]:
    """What such a file says, checked: entries of a Scan, and its unit, mm.

    Errors name `path`. Raises ScanError.
    """
    check_entries(path, said, HEADER)
    target = {**said.get("target", {})}
    guess = said.get("guess", {})
    kind = target.pop("kind", None)
    scale = SCALE[said.get("units", "mm")]
    check_entries(path, {"kind": kind}, ENTRY_RULES, "target")
    lengths = length_rules(kind, scale)
    of_target = {"side": one_of((1, -1))} | lengths
    check_entries(path, target, of_target, "target", needed=lengths)
    given = said.keys() & {"title", "mount", "noise"}
    entries = {name: said[name] for name in given} | {
        "kind": kind,
        "sizes": tuple(round(target[name] * scale, 9) for name in lengths),
        "side": float(target.get("side", 0)),
        "delay_ms": said.get("motion", {}).get("delay_ms"),
        "guess_sd": (
            guess.get("sd_mm", GUESS_SD[0]),
            guess.get("sd_deg", GUESS_SD[1]),
        ),
    }
    if "mount" in guess:
        entries["guess"] = mount_pose(guess["mount"], path)
    return entries, scale


def mount_pose(mount: Sequence[float], path: Path) -> ndarray:
    """The pose (4, 4) of X Y Z mm, W P R degrees, of a guess at `path`. Raises
    ScanError.
    """
    position, angles = np.reshape(mount, (2, 1, 3))
    table = Table(path, {}, ["of the guess"], "W P R")
    R = to_rotations(named("FANUC angles"), angles, table)
    return homogeneous(R, position)[0]


def read_log(path: Path, scale: float) -> Entries:
    """What the robot recorded on its way, positions in units of `scale` mm: entries of
    a Scan. Raises ScanError.
    """
    table = read_table(path, ("t", "x", "y", "z"))
    way = poses_in(table, scale)
    with naming(path):
        log = checked_log(table.column("t"), way["R_base_flange"], way["p_base_flange"])
    return {"log": log, "convention": way["convention"]}


def read_poses(path: Path, scale: float, side: float = 0.0) -> Entries:
    """What a table of poses, in units of `scale` mm, says: entries of a Scan.

    `side` is that of poses for which the table says none. Raises ScanError.
    """
    return check_poses(read_table(path, ("pose", "x", "y", "z")), scale, side)


def check_poses(table: Table, scale: float, side: float = 0.0) -> Entries:
    """The same of a table that has been read."""
    labels = table.labels()
    first, row = np.unique(labels, return_index=True, return_inverse=True)[1:]
    table.refuse(first[row] < np.arange(len(labels)), "pose {} is there twice", labels)
    poses = poses_in(table, scale)
    sides = table.column("side", blank=True)
    sides[np.isnan(sides)] = side
    known = np.isin(sides, (-1, 0, 1))
    table.refuse(~known, "side is {:g}; expected 1 or -1", sides)
    groups = table.text("group")
    given = bool(groups.any())
    blank = given & (groups == "")
    table.refuse(blank, "no group; expected one for each pose, or for none")
    return poses | {
        "labels": tuple(labels),
        "side": sides,
        "group": groups if given else None,
        "group_given": given,
    }


def poses_in(table: Table, scale: float) -> Entries:
    """Where the flange is by a table's rows, positions in units of `scale` mm: entries
    of a Scan.
    """
    with np.errstate(over="ignore"):
        positions = table.numbers(("x", "y", "z")) * scale
        reach = np.linalg.norm(positions, axis=1)
    low, high = REACH_MM
    farthest = reach.max()
    table.refuse(
        (reach == farthest) & ~(low <= farthest <= high),
        "the flange is {:.3g} mm from the base, farther than elsewhere; expected a "
        f"robot's size, {low:g} to {high:g} mm: are the units right?",
        reach,
    )
    with naming(table.path):
        convention = find_convention(table.columns)
    block = table.numbers(convention.columns)
    return {
        "R_base_flange": to_rotations(convention, block, table),
        "p_base_flange": positions,
        "convention": convention.name,
        "orientation": block,
    }


def read_measurements(
    folder: Path, at_rest: Entries, scale: float, moving: bool
) -> Entries:
    """What the scanner saw, in mm, by pose: entries of a Scan. The poses `at_rest`, as
    `read_poses` has them, come first; then what was seen in motion. Raises ScanError.
    """
    ways = (folder / f"{name}{kind}" for name in MEASURED for kind in (".csv", ".npz"))
    paths = [path for path in ways if is_file(path)]
    if len(paths) != 1:
        found = " and ".join(path.name for path in paths) or "none of them"
        raise ScanError(
            f"{folder}: expected one of {listed(MEASURED)} (.csv, .npz); found {found}"
        )
    (path,) = paths
    columns = MEASURED[path.stem]
    keys = ["sweep", "t"] if moving else []
    if at_rest["labels"] or not moving:
        keys.append("pose")
    # of each label: its number, and its sweep and time
    number = {label: k for k, label in enumerate(at_rest["labels"])}
    moment = dict.fromkeys(number, ("", np.nan))
    parts = []
    for table in read_parts(path, (*keys, *columns)):
        labels, in_motion = moments(table) if moving else (table.labels(), {})
        for label in in_motion:
            number.setdefault(label, len(number))
        moment |= in_motion
        pose = np.array([number.get(label, -1) for label in labels])
        table.refuse(pose < 0, "pose {} is not in poses", labels)
        seen = table.numbers(columns, blank=True, largest=FARTHEST_MM / scale)
        parts.append((pose, seen * scale))
    pose, seen = map(np.concatenate, zip(*parts, strict=True))
    # the rows of each pose together, in the order of the file
    rows = seen[np.argsort(pose, kind="stable")]
    ends = np.cumsum(np.bincount(pose, minlength=len(number)))
    sweeps, times = zip(*moment.values(), strict=True)
    return {
        "measured": path.stem,
        "values": tuple(np.split(rows, ends[:-1])),
        "sweeps": sweeps,
        "times": np.array(times),
    }


def moments(table: Table) -> tuple[ndarray, dict[str, tuple[str, float]]]:
    """Labels (rows,) of poses, and of what was seen in motion; of each of the latter
    its sweep and time.
    """
    labels, sweeps = table.text("pose"), table.text("sweep")
    times = table.column("t", blank=True)
    is_moving = np.isfinite(times) & (sweeps != "")
    table.refuse(
        is_moving == (labels != ""),
        "pose {}, sweep {}, t {:g}; expected either a pose, or a sweep with its t",
        labels,
        sweeps,
        times,
    )
    others = {}
    for row in np.flatnonzero(is_moving):
        moment = sweeps[row], float(times[row])
        labels[row] = moment_label(*moment)
        others[labels[row]] = moment
    return labels, others


def poses_columns(R: ndarray, p: ndarray, convention: str) -> dict[str, ndarray]:
    """The columns of poses R (P, 3, 3), p (P, 3), mm, with angles in a convention."""
    angles = named(convention)
    block = np.hstack([p, from_rotations(angles, R)])
    return dict(zip(("x", "y", "z", *angles.columns), block.T, strict=True))


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
    with new_folder(Path(folder)) as partial:
        header = header_of(scan, scan.title, scan.noise) | known_of(scan)
        sides = {*scan.side[scan.moving]} - {0}
        if len(sides) == 1:
            header["target"]["side"] = int(*sides)
        for name, entries in {"scan": header, "truth": scan.truth}.items():
            if entries:
                text = toml_text(entries)
                (partial / f"{name}.toml").write_text(text, encoding="utf-8")
        for name, columns in tables_of(scan).items():
            rows = max(map(len, columns.values()))
            if name == scan.measured and rows > SPREADSHEET:
                np.savez_compressed(partial / f"{name}.npz", **columns)
            else:
                write_table(partial / f"{name}.csv", columns)


def header_of(source: Any, title: str, noise: Mapping) -> Entries:
    """What scan.toml says of any scan, or of one that a specification describes."""
    return {
        "title": title,
        "units": "mm",
        "mount": source.mount,
        "target": {"kind": source.kind} | source.measures,
        "noise": dict(noise),
    }


def known_of(scan: Scan) -> Entries:
    """What scan.toml says besides, of a scan whose delay or mount is known."""
    known: Entries = {}
    if scan.delay_ms is not None:
        known["motion"] = {"delay_ms": scan.delay_ms}
    if scan.guess is not None:
        angles = from_rotations(named("FANUC angles"), scan.guess[None, :3, :3])
        mount = np.append(scan.guess[:3, 3], angles).tolist()
        sd_mm, sd_deg = scan.guess_sd
        known["guess"] = {"mount": mount, "sd_mm": sd_mm, "sd_deg": sd_deg}
    return known


def tables_of(scan: Scan) -> dict[str, dict[str, Any]]:
    """The columns of a scan's tables, by their names."""
    still = ~scan.moving
    labels = np.where(still, scan.labels, "")
    convention = named(scan.convention)
    if scan.log and "t" in convention.columns:
        convention = CONVENTIONS[0]  # the log's t is a time
    tables, keys = {}, {}
    if still.any():
        R, p = scan.R_base_flange[still], scan.p_base_flange[still]
        poses = {"pose": labels[still]} | poses_columns(R, p, convention.name)
        if scan.orientation is not None:  # as read: another convention may be meant
            poses |= zip(convention.columns, scan.orientation.T, strict=True)
        if scan.group_given:
            poses["group"] = scan.group[still]
        if np.any(scan.side):
            poses["side"] = scan.side[still].astype(int)
        tables["poses"], keys["pose"] = poses, labels
    if scan.log:
        way = poses_columns(scan.log.R, scan.log.p, convention.name)
        tables["log"] = {"t": scan.log.t} | way
        keys |= {"sweep": np.array(scan.sweeps), "t": scan.times}
    counts = [len(rows) for rows in scan.values]
    seen = {name: column.repeat(counts) for name, column in keys.items()}
    numbers = np.concatenate(scan.values).T
    seen |= zip(MEASURED[scan.measured], numbers, strict=True)
    return tables | {scan.measured: seen}
