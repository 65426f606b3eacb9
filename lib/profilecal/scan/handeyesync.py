"""Measurements of the public repository HandEyeSync as a scan: FANUC listings and OpenCV YAML profiles.

A folder holds one teach-pendant listing (.ls) with positions P[1] … P[n], and for each a file pN.yml with its profile.
The files are read where a user has put them; see data/README.md.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from profilecal.scan.conventions import named, to_rotations
from profilecal.scan.files import naming
from profilecal.scan.folder import find_groups
from profilecal.scan.scan import Scan, ScanError

NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
POSITION = re.compile(r"^\s*P\[(\d+)[^\]\n]*\][ \t]*\{(.*?)(^\s*\}|^\s*P\[|\Z)", re.MULTILINE | re.DOTALL)
COORDINATES = {"X": "mm", "Y": "mm", "Z": "mm", "W": "deg", "P": "deg", "R": "deg"}
FANUC = named("FANUC angles")
BALL_RADIUS = 40.0  # mm, of the sphere in these measurements
CONSTANT = 1e-3  # mm or degrees by which a further axis may move between positions


@dataclass(frozen=True)
class Listing:
    """The positions of a teach-pendant listing, of the robot's user frame and tool that it names."""

    numbers: tuple[int, ...]  # (P,) N of P[N]
    poses: np.ndarray  # (P, 6) X, Y, Z mm; W, P, R degrees
    user_frame: int
    tool: int


def read_listing(path) -> Listing:
    """The /POS section of a FANUC listing (.ls). Raises ScanError.

    Only group 1 is the robot. Further groups, such as external axes, must not move: they would carry the scanner or
    the target along.
    """
    path = Path(path)
    text = text_of(path)
    section = re.search(r"^\s*/POS\s*$", text, re.MULTILINE)
    if not section:
        raise ScanError(f"{path}: no /POS section; expected a FANUC listing with positions P[1] …")
    numbers, poses, frames, further = [], [], [], {}
    for number, line, body in positions(path, text, section.end()):
        where = f"{path} line {line}: P[{number}]"
        if number in numbers:
            raise ScanError(f"{where} is there twice")
        groups = re.split(r"GP(\d+)\s*:", body)
        content = dict(zip(map(int, groups[1::2]), groups[2::2], strict=True))
        if 1 not in content:
            raise ScanError(f"{where} has no group GP1")
        numbers.append(number)
        poses.append([coordinate(where, content[1], *entry) for entry in COORDINATES.items()])
        frames.append(tuple(frame_number(where, content[1], name) for name in ("UF", "UT")))
        for group in content.keys() - {1}:
            axes = re.findall(rf"=\s*({NUMBER})", content[group])
            further.setdefault(group, []).append([float(value) for value in axes])
    if not numbers:
        raise ScanError(f"{path}: the /POS section holds no position P[1] …")
    refuse_moving(path, further, len(numbers))
    if len(set(frames)) > 1:
        raise ScanError(f"{path}: positions in {len(set(frames))} user frames or tools (UF, UT); expected one of each")
    return Listing(tuple(numbers), np.array(poses), *frames[0])


def text_of(path: Path) -> str:
    """A file's text. Raises ScanError."""
    with naming(path):
        return path.read_text(encoding="utf-8-sig")


def positions(path, text: str, start: int):
    """(N, line, text) of each P[N]{…} from `start`; lines as an editor counts them."""
    for entry in POSITION.finditer(text, start):
        number, body, end = entry.groups()
        line = text.count("\n", 0, entry.start(1)) + 1
        if not end.endswith("}"):
            raise ScanError(f"{path} line {line}: P[{number}] is not closed by }};")
        yield int(number), line, body


def coordinate(where: str, text: str, name: str, unit: str) -> float:
    """One of X, Y, Z, W, P, R. An untaught position has asterisks instead."""
    entry = re.search(rf"(?<![A-Za-z]){name}\s*=\s*(\S+)\s*(\w*)", text)
    if not entry:
        raise ScanError(f"{where} has no {name}; expected X, Y, Z in mm and W, P, R in deg, not joint angles")
    if not re.fullmatch(NUMBER, entry[1]) or entry[2] != unit:
        raise ScanError(f"{where}: {name} is {' '.join(entry.groups()).strip()!r}; expected a number in {unit}")
    return float(entry[1])


def frame_number(where: str, text: str, name: str) -> int:
    """The user frame UF or the tool UT; F, the one in use, counts as 0."""
    entry = re.search(rf"{name}\s*:\s*(\w+)", text)
    if not entry or not re.fullmatch(r"\d+|F", entry[1]):
        raise ScanError(f"{where} has no {name}; expected the number of a frame")
    return 0 if entry[1] == "F" else int(entry[1])


def refuse_moving(path, further: dict, count: int) -> None:
    """Raise ScanError for groups of axes that are not at one place in all positions."""
    for group, values in further.items():
        same = len(values) == count and len({len(v) for v in values}) == 1
        if not same or np.ptp(np.array(values), axis=0).max(initial=0) > CONSTANT:
            raise ScanError(f"{path}: group GP{group} moves between positions; expected external axes to stand still")


def read_profile(path) -> tuple[np.ndarray, np.ndarray | None]:
    """The profile (n, 2) and the hand-picked feature point (2,), if any, x and z in mm, of an OpenCV YAML file."""
    path = Path(path)
    text = text_of(path)
    if "%YAML" not in text[:200]:
        raise ScanError(f"{path}: expected an OpenCV file that begins with %YAML:1.0")
    profile = triplets(path, text, "profile")
    if profile is None:
        raise ScanError(f"{path}: no 'profile: [x, 0, z, …]'")
    point = triplets(path, text, "feature_point")
    return profile, None if point is None or not len(point) else point[0]


def triplets(path, text: str, name: str) -> np.ndarray | None:
    """x and z (n, 2) of a list x, 0, z, …; None where the file has no such entry."""
    entry = re.search(rf"^{name}\s*:\s*\[([^\]]*)(\]?)", text, re.MULTILINE)
    if not entry:
        return None
    line = text[: entry.start()].count("\n") + 1
    if not entry[2]:
        raise ScanError(f"{path} line {line}: the list {name} is not closed; is the file cut short?")
    words = [word.strip() for word in entry[1].split(",")] if entry[1].strip() else []
    try:
        values = np.array([float(word.replace(".Nan", "nan").replace(".Inf", "inf")) for word in words])
    except ValueError:
        bad = next(word for word in words if not re.fullmatch(rf"{NUMBER}|[-+]?\.(Nan|Inf)", word))
        raise ScanError(f"{path} line {line}: {name} holds {bad[:40]!r}; expected numbers") from None
    if len(values) % 3:
        raise ScanError(f"{path} line {line}: {name} has {len(values)} numbers; expected triplets x, 0, z")
    values = values.reshape(-1, 3)
    if (np.abs(values[:, 1]) > 0).any():
        raise ScanError(f"{path} line {line}: {name} has a y of {values[values[:, 1] != 0][0, 1]:g}; expected 0")
    return values[:, [0, 2]]


def read_handeyesync(folder, kind: str | None = None, picked: bool = False) -> Scan:
    """A folder of measurements as a scan with FANUC angles, one pose for each P[N] that has a profile pN.yml.

    `kind` edge or ball; left out, what the profiles' `feature_point`s say. `picked`: those points, instead of profiles.
    Raises ScanError.
    """
    folder = Path(folder)
    listings = sorted(folder.glob("*.[lL][sS]"))
    if len(listings) != 1:
        raise ScanError(f"{folder}: {len(listings)} listings (.ls); expected one")
    listing = read_listing(listings[0])
    missing = [n for n in listing.numbers if not (folder / f"p{n}.yml").exists()]
    if missing:
        raise ScanError(f"{folder}: no p{missing[0]}.yml for position P[{missing[0]}] of {listings[0].name}")
    spare = sorted(p.name for p in folder.glob("p*.yml") if p.stem[1:] not in set(map(str, listing.numbers)))
    if spare:
        raise ScanError(f"{folder / spare[0]}: no such position in {listings[0].name}")
    profiles, points = zip(*(read_profile(folder / f"p{n}.yml") for n in listing.numbers), strict=True)
    there = [point is not None and bool(np.any(point)) for point in points]
    kind = kind or ("edge" if all(there) else "ball")
    if kind not in ("edge", "ball"):
        raise ScanError(f"{folder}: kind is {kind!r}; expected edge or ball")
    if picked and not all(there):
        raise ScanError(f"{folder / f'p{listing.numbers[there.index(False)]}.yml'}: no feature_point")
    R = to_rotations(FANUC, listing.poses[:, 3:])
    return Scan(
        kind=kind,
        labels=tuple(f"P{n}" for n in listing.numbers),
        R_base_flange=R,
        T_base_flange=listing.poses[:, :3],
        measured="points" if picked else "profiles",
        values=tuple(point[None] for point in points) if picked else profiles,
        sizes=(BALL_RADIUS,) if kind == "ball" else (),
        side=np.zeros(len(R)),
        group=find_groups(R),
        title=f"HandEyeSync {folder.name}, user frame {listing.user_frame}, tool {listing.tool}",
        convention=FANUC.name,
    )
