"""From a folder of files to a scan, step by step."""

import re
from collections import ChainMap, defaultdict
from contextlib import nullcontext, suppress
from itertools import chain
from pathlib import Path

import numpy as np

from profilecal.geometry.log import GAP
from profilecal.geometry.progress import watched
from profilecal.scan.folder import NO_POSES, check_header, scan_of
from profilecal.scan.scan import Scan, checked_log
from profilecal.scan.tables import ScanError, listed, naming
from profilecal_tool.importing.blocks import (
    Block,
    Blocks,
    Files,
    Poses,
    counted,
    label_of,
)
from profilecal_tool.importing.folder_files import (
    files_matching,
    patterns_of,
    sorted_files,
)
from profilecal_tool.importing.heights import with_a_point_a_row
from profilecal_tool.importing.pair_profiles import Pairing, Times, pair_profiles
from profilecal_tool.importing.questions import Layout, Question, Taken, one_or_ask
from profilecal_tool.importing.read_file import blocks_in_file
from profilecal_tool.importing.robot_poses import (
    Fields,
    likely_pose,
    pose_fields,
    poses_in,
    robot_poses,
)
from profilecal_tool.importing.scanner_profiles import (
    Profiles,
    points_of_file,
    read_profiles,
)
from profilecal_tool.importing.tool_frames import (
    check_moves_beside,
    fields_of_flange,
    lines_of_program,
    of_one_tool,
)

NOTHING_SAID = Layout()
Families = dict[str, Files]  # the files of each pattern


def import_scan(
    folder: Path, kind: str, sizes: dict, layout: Layout = NOTHING_SAID
) -> tuple[Scan, Taken]:
    """The scan of a target of these sizes, mm by name, in a folder of files; and what
    was taken for granted, by what it is about.

    Raises ScanError; Question where it is uncertain.
    """
    target = {"kind": kind} | sizes
    about = {"title": folder.resolve().name, "mount": layout.mount, "target": target}
    header, _ = check_header(folder, about)
    poses, profiles, blocks, taken = read_folder(folder, layout)
    program = lines_of_program(blocks, poses.robot)
    poses, T_flange_tool, on_tool = of_one_tool(poses, program, blocks, layout)
    moves = [row.get("name") for row in program["uses"]]
    pairing = pair_profiles(poses, [*profiles.index], moves, layout)
    poses = poses.rows_at(pairing.rows)
    check_moves_beside(poses, program)  # of these alone
    if not all(profiles.index):  # by which nothing was paired
        profiles = profiles.set_axis(counted(len(profiles)))
    profiles = profiles.iloc[pairing.profiles]
    names = [*profiles.index]
    check_one_profile_a_pose(folder, pairing, names, layout)
    labels = counted(len(pairing.rows)) if pairing.times else names
    fields, on_poses = pose_fields(poses, labels)
    if T_flange_tool is not None:
        fields = fields_of_flange(fields, T_flange_tool)
    if pairing.times:
        fields = in_sweeps(folder, fields, pairing.times)
    measured, empty = points_or_profiles(profiles)
    taken["missing"] += empty
    taken |= {"tool": on_tool, "matched": pairing.how} | on_poses
    return scan_of(folder, header | fields | measured), taken


def read_folder(folder: Path, layout: Layout) -> tuple[Poses, Profiles, Blocks, Taken]:
    """The robot's poses, the profiles, all that files hold, and what was taken for
    granted. Raises ScanError.
    """
    families = families_in(folder, layout)
    of_poses, of_profiles = map(families.get, which_hold_what(folder, families, layout))
    files = ChainMap(*families.values())
    blocks = [*chain(*files.values())]
    check_wanted(folder, blocks, layout)
    read = {*of_poses, *of_profiles, *(block.path for block in blocks if block.robot)}
    left_out = listed(sorted(path.name for path in files.keys() - read)) or "none"
    poses = robot_poses(of_poses, layout)
    rows = len(poses.table)
    is_both = of_poses.keys() == of_profiles.keys()
    expected = 0 if is_both else rows
    profiles, entry, taken = read_profiles(of_profiles, expected, layout)
    counts = profiles.map(len)
    # rows with a pose and a point each: a profile, which is of rows that follow each
    # other, has the pose of its first row
    if is_both and sum(counts) == rows:
        poses = poses.rows_at(counts.cumsum() - counts)
    entries = f"{poses.entry} {entry}".strip()
    if layout.entry.lower() not in entries.lower():
        raise ScanError(f"{folder}: no entry {layout.entry}; those read are {entries}")
    if not is_both:  # a scanner's tools are no robot's
        blocks = [block for block in blocks if block.path not in of_profiles]
    return poses, profiles, blocks, {"files left out": left_out} | taken


def families_in(folder: Path, layout: Layout) -> Families:
    """The files of a folder by their patterns, with their blocks of the rows that are
    wanted, with a point in each. Where a user says both patterns, the other files may
    say what tool the poses have, and have as many blocks as can be read.

    Raises ScanError.
    """
    given = [*filter(None, (layout.poses, layout.profiles))]
    # the narrower one last: the last takes a file
    given.sort(key=lambda pattern: -len(files_matching(folder, pattern)))
    families = defaultdict(dict)
    for path, pattern in watched([*patterns_of(folder, given).items()], "reading"):
        is_further = len(given) == 2 and pattern not in given
        families[pattern][path] = blocks = []
        with suppress(ScanError) if is_further else nullcontext():
            for block in blocks_in_file(path, layout.encoding):
                wanted = with_rows_wanted(block, layout)
                blocks.append(with_a_point_a_row(wanted, layout))
    for pattern in given:  # the last took all files of the first: both mean the same
        families.setdefault(pattern, families[given[-1]])
    return families


def with_rows_wanted(block: Block, layout: Layout) -> Block:
    """A block with the rows that are wanted, if it has the column."""
    if block.kind != "pose":
        return block  # what moves use says which poses are not wanted
    name, value = layout.wanted
    for column in block.unposed:
        if name in (column.name, column.role) and value not in ("", "*"):
            cells = block.table[column.at]
            # 0 and 0.0 are both 0.0
            is_wanted = [value in (str(c).lower(), label_of(c).lower()) for c in cells]
            block = block.rows_at(is_wanted)
    return block


def check_wanted(folder: Path, blocks: Blocks, layout: Layout) -> None:
    """Raise ScanError where rows are wanted by a column that no block has."""
    names = {n for block in blocks for c in block.unposed for n in (c.name, c.role)}
    if layout.wanted[0] not in {*names, "", "tool", "base"}:
        raise ScanError(
            f"{folder}: no rows where {layout.where}; the columns are "
            f"{listed(sorted(names - {''}))}"
        )


def which_hold_what(
    folder: Path, families: Families, layout: Layout
) -> tuple[str, str]:
    """Which files hold poses, and which profiles: as is said, or else by their blocks::

        robot.csv (x, y, z, a, b, c), scan_*.csv (x, z)   robot.csv, scan_*.csv
        log.csv (tcp_x, …, tcp_c, laser_x, laser_z)       log.csv, log.csv
        poses.txt (1, …, 6: asked), scan_*.csv (x, z)     poses.txt, scan_*.csv

    Raises ScanError; Question where several may.
    """
    by_count = sorted(families, key=lambda name: -len(families[name]))
    # of files alike, what the first has that has any
    blocks_of = {n: next(filter(None, families[n].values()), []) for n in by_count}
    said = layout.poses, layout.profiles
    unsaid = [name for name in by_count if blocks_of[name] and name not in said]
    count_of = {}  # poses in those files that have some
    for name in unsaid:
        if found := poses_in(blocks_of[name], layout.pose_columns):
            rows = max(len(poses.table) for poses in found)
            count_of[name] = rows * len(families[name])
    # a pose alone, beside others, is a tool's or a target's
    with_poses = [name for name in count_of if count_of[name] > 1] or [*count_of]
    others = [name for name in unsaid if name not in with_poses]
    # half as many files are something else, such as a reference
    most = [n for n in others if 2 * len(families[n]) > len(families[others[0]])]
    with_points = [n for n in most if points_of_file(blocks_of[n], layout)]
    unclear = [name for name in others if name not in with_points]
    # poses that no title tells are in the fewest files, or beside profiles
    with_poses = with_poses or unclear[::-1]
    if not (with_poses or layout.poses):
        with_poses = [n for n in with_points if any(map(likely_pose, blocks_of[n]))]
    pose = layout.poses or one_or_ask(folder, with_poses, "holds the poses", "poses")
    # and profiles in those that are left, or both in the same
    blocks = blocks_of[pose]
    with_points = with_points or [name for name in unclear if name != pose]
    if not with_points and points_of_file(blocks, layout):
        with_points = [pose]
    return pose, layout.profiles or one_of_profiles(folder, with_points, pose, blocks)


def one_of_profiles(
    folder: Path, patterns: list[str], pose: str, blocks: Blocks
) -> str:
    """The one of some patterns of profiles. Raises ScanError for none; Question for
    several, which may be called as the poses are, whose pattern and blocks these are.
    """
    labels = {*chain(*(chain(*block.labels.values()) for block in blocks))}
    if len(patterns) > 1 and labels.issuperset(Path(n).stem for n in patterns):
        every = str(Path(patterns[0]).with_stem("*"))
        sentence = f"{folder}: are {listed(patterns)} profiles of the poses called so?"
        raise Question(sentence, poses=pose, profiles=every)
    what = "holds the profiles (a pattern takes several)"
    return one_or_ask(folder, patterns, what, "profiles")


def points_or_profiles(profiles: Profiles) -> tuple[Fields, str]:
    """Fields of a Scan: points, where each profile has one row; or profiles, which are
    empty where fewer than two points were seen; and words on those.
    """
    if profiles.map(len).max() == 1:
        return {"measured": "points", "values": tuple(profiles)}, ""
    is_seen = profiles.map(lambda points: np.isfinite(points[:, 1]).sum() > 1)
    pairs = zip(profiles, is_seen, strict=True)
    kept = tuple(points if seen else points[:0] for points, seen in pairs)
    empty = listed(profiles.index[~is_seen])
    words = f"; empty: {empty}" if empty else ""
    return {"measured": "profiles", "values": kept}, words


def check_one_profile_a_pose(
    folder: Path, pairing: Pairing, names: list[str], layout: Layout
) -> None:
    """Raise Question where several profiles are of one pose, and no one said which;
    ScanError where their names are labels in one file, of which no pattern tells some.
    """
    again = np.flatnonzero(np.diff(pairing.rows) == 0)
    if len(again) and not layout.profiles:
        one, other, *_ = names[again[0] :]
        parts = zip(*(re.findall(r"\d+|\D+", n) for n in (one, other)), strict=False)
        like = "".join("*" if a == b and a.isdigit() else a for a, b in parts)
        sentence = f"{folder}: {one} and {other} are of one pose"
        if not sorted_files(folder, f"{like}.*"):
            raise ScanError(f"{sentence}; leave one out")
        every = re.sub(r"\d+", "*", f"{one}.*")
        raise Question(f"{sentence}; which? (all: '{every}')", profiles=f"{like}.*")


def in_sweeps(folder: Path, fields: Fields, both: Times) -> Fields:
    """Fields of a Scan in motion, from those of the log's poses. Raises ScanError."""
    times = both.profiles
    with naming(folder):  # a log's faults are said of arrays
        log = checked_log(both.log, fields["R_base_flange"], fields["p_base_flange"])
        begins = np.diff(times, prepend=times[0]) > GAP * np.median(np.diff(times))
        sweeps = [f"s{number}" for number in np.cumsum(begins) + 1]
    return NO_POSES | {
        "log": log,
        "times": times,
        "sweeps": tuple(sweeps),
        "side": 0,  # no file says from which a sweep was: all are of one
        "convention": fields["convention"],
    }
