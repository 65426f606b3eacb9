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
from profilecal.geometry.progress import watched
from profilecal.scan.conventions import (
    find_convention,
    from_rotations,
    named,
    to_rotations,
)
from profilecal.scan.scan import (
    DELAY_MS,
    ENTRY_RULES,
    GUESS_SD,
    MEASURED,
    Scan,
    checked_log,
    size_rules,
    the_one,
)
from profilecal.scan.tables import (
    Columns,
    ScanError,
    Table,
    is_file,
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
SPREADSHEET = 1_000_000  # rows that one opens
SD_LIMITS = np.array([[0.001, 1000], [0.001, 180]])  # of a guess, mm and degrees
HEADER: Entries = {  # what scan.toml may say; that of [target] depends on its kind
    "title": ENTRY_RULES["title"],
    "units": one_of(SCALE),
    "mount": ENTRY_RULES["mount"],
    "target": TABLE,
    "noise": ENTRY_RULES["noise"],
    "motion": {"delay_ms": DELAY_MS},
    "guess": {
        "mount": numbers(6),
        "sd_mm": number(*SD_LIMITS[0]),
        "sd_deg": number(*SD_LIMITS[1]),
    },
}
TOO_FAR = (
    f"; expected at most {FARTHEST_MM:g}: are the units in scan.toml right? "
    "Missing points are left out or blank"
)
# entries of a Scan without poses at rest
NO_POSES: Entries = {
    "labels": (),
    "R_base_flange": np.empty((0, 3, 3)),
    "p_base_flange": np.empty((0, 3)),
    "side": np.empty(0),
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
    place = Path(folder)
    with naming(place):
        if place.is_file():
            raise ScanError(f"{place} is a file; expected a scan folder")
        if not place.is_dir():
            raise ScanError(f"{place}: no such folder")
    header, scale = read_header(place / "scan.toml")
    poses, log = place / "poses.csv", place / "log.csv"
    moving = is_file(log)
    motion = read_log(log, scale) if moving else {}
    at_rest = NO_POSES
    if not moving or is_file(poses):
        at_rest = read_poses(poses, scale, header["side"])
    seen = read_measurements(place, at_rest["labels"], scale, moving)
    # what was seen in motion has one side
    side = np.full(len(seen["values"]), header["side"], dtype=float)
    side[: len(at_rest["side"])] = at_rest["side"]
    return scan_of(place, header | at_rest | motion | seen | {"side": side})


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
    scale = SCALE[said.get("units", "mm")]
    target, guess = said.get("target", {}), said.get("guess", {})
    sizes = size_rules(target.get("kind"), scale)
    rules = {"kind": ENTRY_RULES["kind"], "side": one_of((1, -1))} | sizes
    check_entries(path, dict.fromkeys(("kind", *sizes)) | target, rules, "target")
    known = {name: said[name] for name in ENTRY_RULES if name in said}
    if guess:
        check_entries(path, {"mount": None} | guess, HEADER["guess"], "guess")
        known["guess"] = mount_pose(guess["mount"], path)
    sd_mm, sd_deg = GUESS_SD
    entries = {
        "kind": target["kind"],
        # 20.3 mm of 0.0203 m, not 20.299999999999997
        "sizes": {name: round(scale * target[name], 9) for name in sizes},
        "mount": Scan.mount,
        "side": target.get("side", 0),
        "delay_ms": said.get("motion", {}).get("delay_ms"),
        "guess_sd": (guess.get("sd_mm", sd_mm), guess.get("sd_deg", sd_deg)),
    }
    return entries | known, scale


def mount_pose(mount: Sequence[float], path: Path) -> ndarray:
    """The pose (4, 4) of X Y Z mm, W P R degrees, of a guess at `path`. Raises
    ScanError.
    """
    place = Table(path, {}, ["the guess"], "W P R of")
    R = to_rotations(named("FANUC angles"), [mount[3:]], place)[0]
    return homogeneous(R, np.array(mount[:3]))


def read_log(path: Path, scale: float) -> Entries:
    """What the robot recorded on its way, positions in units of `scale` mm: entries of
    a Scan. Raises ScanError.
    """
    table = read_table(path, ("t", *"xyz"))
    t = table.column("t")
    del table.columns["t"]  # no angle, though a robot has one of that name
    poses = poses_in(table, scale)
    with naming(path):
        log = checked_log(t, poses["R_base_flange"], poses["p_base_flange"])
    return {"log": log, "convention": poses["convention"]}


def read_poses(path: Path, scale: float, side: float = 0.0) -> Entries:
    """What a table of poses, in units of `scale` mm, says: entries of a Scan.

    `side` is that of poses for which the table says none. Raises ScanError.
    """
    return check_poses(read_table(path, ["pose", *"xyz"]), scale, side)


def check_poses(table: Table, scale: float, side: float = 0.0) -> Entries:
    """The same of a table that has been read."""
    labels, group = table.labels(), table.text("group")
    _, firsts = np.unique(labels, return_index=True)
    is_again = ~np.isin(np.arange(len(labels)), firsts)
    table.refuse(is_again, "pose ", labels, " is there twice")
    sides = table.column("side", blank=True)
    sides = np.where(np.isnan(sides), side, sides)
    table.refuse(~np.isin(sides, (1, -1, 0)), "side is ", sides, "; expected 1 or -1")
    given = bool((group != "").any())
    is_blank = given & (group == "")
    table.refuse(is_blank, "no group; expected one for each pose, or for none")
    return poses_in(table, scale) | {
        "labels": tuple(labels.tolist()),
        "side": sides,
        "group": group if given else None,
        "group_given": given,
    }


def poses_in(table: Table, scale: float) -> Entries:
    """Where the flange is by a table's rows, positions in units of `scale` mm: entries
    of a Scan.
    """
    with naming(table.path):
        convention = find_convention(table.columns)
    p = scale * table.numbers("xyz")
    distance = np.linalg.norm(p, axis=1)
    low, high = REACH_MM
    is_off = (distance > high) | (distance.max() < low)
    expected = (
        " mm from the base; expected a robot's size, "
        f"{low:g} to {high:g} mm: are the units right?"
    )
    table.refuse(is_off, "the flange is ", distance, expected)
    block = table.numbers(convention.columns)
    return {
        "R_base_flange": to_rotations(convention, block, table),
        "p_base_flange": p,
        "convention": convention.name,
        "orientation": block,
    }


def read_measurements(
    folder: Path, labels: Sequence[str], scale: float, moving: bool
) -> Entries:
    """What the scanner saw, in mm, by pose: entries of a Scan. The poses at rest come
    first, by their labels; then what was seen in motion. Raises ScanError.
    """
    with naming(folder):
        names = [name + end for name in MEASURED for end in (".csv", ".npz")]
        found = [name for name in names if is_file(folder / name)]
        path = folder / the_one(found, " (.csv, .npz)")
    columns = MEASURED[path.stem]
    of_poses = ["pose"] if labels or not moving else []
    required = (*of_poses, *["sweep", "t"] * moving, *columns)
    # where each pose stands, by its label; in motion, by its sweep and time
    place: dict[Any, int] = {label: k for k, label in enumerate(labels)}
    places, values = [], []
    for table in watched(read_parts(path, required), f"reading {path.name}"):
        keys = keys_of(table) if moving else table.labels().tolist()
        for key in keys:
            if isinstance(key, tuple):
                place.setdefault(key, len(place))
        own = np.array([place.get(key, -1) for key in keys])
        table.refuse(own < 0, "pose ", keys, " is not in poses")
        rows = scale * table.numbers(columns, blank=True)
        for name, column in zip(columns, rows.T, strict=True):
            table.refuse(np.abs(column) > FARTHEST_MM, f"{name} is ", column, TOO_FAR)
        places.append(own)
        values.append(rows)
    del table  # it holds on to all arrays of an .npz file
    every = np.concatenate(places)
    order = np.argsort(every, kind="stable")
    ends = np.bincount(every, minlength=len(place)).cumsum()[:-1]
    rows = np.concatenate(values)[order]
    at_rest = [("", np.nan)] * len(labels)
    sweeps, times = zip(*at_rest, *[*place][len(labels) :], strict=True)
    return {
        "measured": path.stem,
        "values": tuple(np.split(rows, ends)),
        "sweeps": sweeps,
        "times": np.array(times),
    }


def keys_of(table: Table) -> list[Any]:
    """Of each row the pose's label or, in motion, its sweep and time."""
    pose, sweep, t = table.text("pose"), table.text("sweep"), table.column("t", True)
    at_rest = pose != ""
    is_wrong = (at_rest == (sweep != "")) | (at_rest == np.isfinite(t))
    expected = "; expected either a pose, or a sweep with its t"
    table.refuse(is_wrong, "pose ", pose, ", sweep ", sweep, ", t ", t, expected)
    rows = zip(pose.tolist(), sweep.tolist(), t.tolist(), strict=True)
    return [label or (name, time) for label, name, time in rows]


def write_scan(scan: Scan, folder: str | Path) -> None:
    """Write a scan as a new folder of its own, in mm.

    Parameters
    ----------
    scan : Scan
        What to write; where it is simulated, its truth goes to truth.toml. More than a
        million rows, which no spreadsheet opens, become an .npz file. Orientations are
        as they were read, but beside a log. What was measured in motion comes after the
        poses at rest.
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
    texts = {"scan": known_of(scan), "truth": scan.truth}
    with new_folder(Path(folder)) as place, naming(folder):
        for name, entries in texts.items():
            if entries:
                (place / f"{name}.toml").write_text(toml_text(entries), "utf-8")
        for name, columns in tables_of(scan).items():
            if name in MEASURED and sum(map(len, scan.values)) > SPREADSHEET:
                np.savez_compressed(place / f"{name}.npz", **columns)
            else:
                write_table(place / f"{name}.csv", columns)


def header_of(source: Any, title: str, noise: Mapping) -> Entries:
    """What scan.toml says of any scan, or of one that a specification describes."""
    return {
        "title": title,
        "units": "mm",
        "mount": source.mount,
        "target": {"kind": source.kind} | source.sizes,
        "noise": dict(noise),
    }


def known_of(scan: Scan) -> Entries:
    """What scan.toml says of a scan."""
    header = header_of(scan, scan.title, scan.noise)
    sides = scan.side[scan.moving]
    if sides.any():
        header["target"]["side"] = sides[0]
    if scan.delay_ms is not None:
        header["motion"] = {"delay_ms": scan.delay_ms}
    if scan.guess is not None:
        angles = from_rotations(named("FANUC angles"), scan.guess[None, :3, :3])
        mount = np.append(scan.guess[:3, 3], angles).tolist()
        sd_mm, sd_deg = np.clip(scan.guess_sd, *SD_LIMITS.T)  # it may be infinite
        header["guess"] = {"mount": mount, "sd_mm": sd_mm, "sd_deg": sd_deg}
    return header


def poses_columns(
    R: ndarray, p: ndarray, convention: str, read: ndarray | None = None
) -> Columns:
    """The columns of poses R (P, 3, 3), p (P, 3), mm, with angles in a convention, as
    they were `read`, if they were.
    """
    turn = named(convention)
    block = from_rotations(turn, R) if read is None else read
    return dict(zip((*"xyz", *turn.columns), np.hstack([p, block]).T, strict=True))


def tables_of(scan: Scan) -> dict[str, Columns]:
    """The columns of a scan's tables, by their names."""
    turn, log, still = named(scan.convention), scan.log, ~scan.moving
    if log and "t" in turn.columns:  # which is a time
        turn = named("quaternion")
    counts = [*map(len, scan.values)]
    tables: dict[str, Columns] = {}
    where, labels = {}, np.array(scan.labels)
    if still.any():
        R, p = scan.R_base_flange[still], scan.p_base_flange[still]
        columns = poses_columns(R, p, turn.name, scan.orientation)
        poses = {"pose": labels[still]} | columns
        if scan.side.any():
            poses["side"] = scan.side[still]
        if scan.group_given:
            poses["group"] = scan.group[still]
        tables["poses"] = poses
        where["pose"] = np.where(still, labels, "").repeat(counts)
    if log:
        tables["log"] = {"t": log.t} | poses_columns(log.R, log.p, turn.name)
        where["sweep"] = np.array(scan.sweeps).repeat(counts)
        where["t"] = scan.times.repeat(counts)
    rows = np.concatenate(scan.values).T
    seen = zip(MEASURED[scan.measured], rows, strict=True)
    return tables | {scan.measured: where | dict(seen)}
