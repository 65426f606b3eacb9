"""Scan folders, as data/README.md describes them: read with every mistake named, and
written. Lengths become mm.
"""

from dataclasses import fields
from pathlib import Path

import numpy as np

from profilecal.geometry.noise import Noise, Systematic
from profilecal.geometry.poses import rotation_groups
from profilecal.scan.conventions import (
    find_convention,
    from_rotations,
    named,
    to_rotations,
)
from profilecal.scan.scan import Scan, ScanError
from profilecal.scan.tables import (
    Table,
    is_file,
    listed,
    naming,
    new_folder,
    read_table,
    write_table,
)
from profilecal.scan.toml import (
    TABLE,
    TEXT,
    check_entries,
    number,
    one_of,
    read_toml,
    toml_text,
)
from profilecal.targets import TARGETS

MEASURED = {
    "profiles": ("x", "z"),
    "points": ("x", "z"),
    "chords": ("x_a", "z_a", "x_b", "z_b"),
    "arcs": ("x", "z", "r"),
}
SCALE = {"mm": 1.0, "m": 1000.0}
MOUNTS = ("eye-in-hand", "eye-to-hand")
NOISE = dict.fromkeys(  # an error that is there is no rounding error
    (field.name for kind in (Noise, Systematic) for field in fields(kind)),
    (
        lambda value: number(0, 100)[0](value) and (value == 0 or value >= 1e-6),
        "zero, or 1e-06 to 100",
    ),
)
REACH_MM = (10.0, 20_000.0)  # farthest flange position from the base: a robot's size
# from the scanner; no profile scanner sees as far, and some print such numbers for no
# point
FARTHEST_MM = 10_000.0


def read_scan(folder) -> Scan:
    """Read and check a scan folder. Raises ScanError."""
    folder = Path(folder)
    if not folder.exists():
        raise ScanError(f"{folder}: no such folder")
    header = read_header(folder / "scan.toml")
    scale = SCALE[header["units"]]
    poses = read_poses(folder / "poses.csv", scale, header["target"].get("side", 0))
    measured, values = read_measurements(folder, poses["labels"], scale)
    return scan_of(folder, header, poses, measured, values)


def scan_of(folder: Path, header: dict, poses: dict, measured: str, values) -> Scan:
    """The scan of a checked header, entries of a Scan, and rows in mm by pose."""
    target = header["target"]
    kind, scale = target["kind"], SCALE[header["units"]]
    fits = TARGETS[kind].tables
    if measured not in fits:
        raise ScanError(
            f"{folder}: a target of kind {kind!r} needs {' or '.join(fits)}, not {measured}"
        )
    sizes = tuple(target[name] * scale for name in TARGETS[kind].lengths)
    said = {name: header[name] for name in ("noise", "mount", "title")}
    return Scan(
        kind=kind, measured=measured, values=values, sizes=sizes, **said, **poses
    )


def read_header(path: Path) -> dict:
    """scan.toml, checked, with defaults filled in."""
    if not is_file(path):
        hint = 'expected it to name the target: [target] kind = "edge" (other files: profilecal import)'
        raise ScanError(f"{path}: no such file; {hint}")
    return check_header(path, read_toml(path))


def check_header(path: Path, header: dict) -> dict:
    """What such a file says, checked, with defaults filled in; errors name `path`.
    Raises ScanError.
    """
    rules = {
        "title": TEXT,
        "units": one_of(SCALE),
        "mount": one_of(MOUNTS),
        "target": TABLE,
        "noise": NOISE,
    }
    header = {
        "title": "",
        "units": "mm",
        "mount": "eye-in-hand",
        "target": {},
        "noise": {},
    } | header
    target = check_entries(path, header, rules)["target"]
    check_entries(
        path, {"kind": target.get("kind")}, {"kind": one_of(TARGETS)}, "target"
    )
    lengths = length_rules(target["kind"], SCALE[header["units"]])
    check_entries(
        path,
        target,
        {"kind": TEXT, "side": one_of((1, -1))} | lengths,
        "target",
        needed=lengths,
    )
    return header


def length_rules(kind: str, scale: float = 1.0) -> dict:
    """What the lengths of a target that a profile scanner can see may be, in units of
    `scale` mm.
    """
    return dict.fromkeys(TARGETS[kind].lengths, number(0.5 / scale, 1000 / scale))


def read_poses(path: Path, scale: float, side: int = 0) -> dict:
    """What a table of poses, in units of `scale` mm, says: entries of a Scan. `side`:
    of poses for which it says none. Raises ScanError.
    """
    return check_poses(read_table(path, ("pose", "x", "y", "z")), scale, side)


def check_poses(table: Table, scale: float, side: int = 0) -> dict:
    """The same of a table that has been read."""
    labels = table.labels()
    first, which = np.unique(labels, return_index=True, return_inverse=True)[1:]
    table.refuse(
        first[which] < np.arange(len(labels)), "pose {} is there twice", labels
    )
    with np.errstate(over="ignore"):
        T = table.numbers(("x", "y", "z")) * scale
        reach = np.linalg.norm(T, axis=1)
    with naming(table.path):
        convention = find_convention(table.columns)
        block = table.numbers(convention.columns)
        R = to_rotations(convention, block, table)
    (low, high), farthest = REACH_MM, reach.max()
    off = (reach == farthest) & ~(low <= farthest <= high)
    hint = f"expected a robot's size, {low:g} to {high:g} mm: are the units right?"
    said = f"the farthest flange position, of pose {{}}, is {{:.3g}} mm from the base; {hint}"
    table.refuse(off, said, labels, reach)
    table.columns.setdefault("side", [side] * len(labels))
    sides = table.numbers(("side",), blank=True)[:, 0]
    sides[np.isnan(sides)] = side
    table.refuse(~np.isin(sides, (-1, 0, 1)), "side is {:g}; expected 1 or -1", sides)
    given = [str(cell).strip() for cell in table.columns.get("group", ())]
    if any(given):
        table.refuse(
            [not cell for cell in given],
            "no group; expected one for each pose, or for none",
        )
    group = (
        np.unique(given, return_inverse=True)[1] if any(given) else rotation_groups(R)
    )
    return {
        "labels": tuple(labels),
        "R_base_flange": R,
        "T_base_flange": T,
        "side": sides,
        "group": group,
        "group_given": any(given),
        "convention": convention.name,
        "orientation": block,
    }


def read_measurements(
    folder: Path, labels, scale: float
) -> tuple[str, tuple[np.ndarray, ...]]:
    """What the scanner saw: which of the four files there is, and its rows in mm by
    pose.
    """
    there = [name for name in MEASURED if is_file(folder / f"{name}.csv")]
    if len(there) != 1:
        found = " and ".join(there) or "none of them"
        raise ScanError(
            f"{folder}: expected one of {listed(MEASURED)} (.csv); found {found}"
        )
    (measured,) = there
    table = read_table(folder / f"{measured}.csv", ("pose", *MEASURED[measured]))
    seen = table.labels()
    known = {label: pose for pose, label in enumerate(labels)}
    pose = np.array([known.get(label, -1) for label in seen])
    table.refuse(pose < 0, "pose {} is not in poses", seen)
    numbers = (
        table.numbers(MEASURED[measured], blank=True, largest=FARTHEST_MM / scale)
        * scale
    )
    counts = np.bincount(pose, minlength=len(labels))
    whole_profile = "more, or none where the scanner saw nothing (single sensed points belong into points.csv)"
    wrong, expected = (
        (counts == 1, whole_profile) if measured == "profiles" else (counts > 1, "one")
    )
    table.refuse(
        wrong[pose], f"pose {{}} has {{}} rows; expected {expected}", seen, counts[pose]
    )
    largest = np.nanmax(np.abs(numbers), initial=0.0)
    if 0 < largest < 1:
        raise ScanError(
            f"{table.path}: no value is larger than {largest:.3g} mm; are the units in scan.toml right?"
        )
    by_pose = numbers[np.argsort(pose, kind="stable")]
    return measured, tuple(np.split(by_pose, np.cumsum(counts)[:-1]))


def poses_columns(labels, R, T, convention: str) -> dict:
    """The columns of poses R (P, 3, 3), T (P, 3), mm, with angles in a named
    convention.
    """
    angles = named(convention)
    names, block = (
        ("pose", *"xyz", *angles.columns),
        np.hstack([T, from_rotations(angles, R)]),
    )
    return dict(zip(names, (labels, *block.T), strict=True))


def write_scan(scan: Scan, folder) -> None:
    """Write a scan as a folder of its own, in mm. Raises ScanError if it is taken."""
    poses = poses_columns(
        scan.labels, scan.R_base_flange, scan.T_base_flange, scan.convention
    )
    if scan.group_given:
        poses["group"] = scan.group
    if np.any(scan.side):
        poses["side"] = scan.side.astype(int)
    values = dict(
        zip(MEASURED[scan.measured], np.concatenate(scan.values).T, strict=True)
    )
    labels = np.repeat(
        np.array(scan.labels, dtype=object), [len(rows) for rows in scan.values]
    )
    with new_folder(Path(folder)) as partial:
        target = {"kind": scan.kind} | scan.measures
        header = {
            "title": scan.title,
            "units": "mm",
            "mount": scan.mount,
            "target": target,
            "noise": scan.noise,
        }
        (partial / "scan.toml").write_text(toml_text(header), encoding="utf-8")
        write_table(partial / "poses.csv", poses)
        write_table(partial / f"{scan.measured}.csv", {"pose": labels} | values)
        if scan.truth:
            (partial / "truth.toml").write_text(toml_text(scan.truth), encoding="utf-8")
