"""Nested text: JSON whose poses are in lists, YAML with lists of points."""

import json
import re
from pathlib import Path

from profilecal.scan.tables import Rows
from profilecal_tool.importing.arrays import chosen
from profilecal_tool.importing.tables import NUMBER, line_of

NAMED_LIST = re.compile(r"^ *(\w+) *:\s*\[([^\[\]]*)\]", re.MULTILINE)


def poses_in_lists(text: str) -> Rows:
    """Poses in JSON whose numbers are in lists of their own: a matrix, a position
    beside a quaternion.
    """
    try:
        poses = json.loads(text, object_hook=lambda named: [*named.values()])
        while isinstance(poses, list) and len(poses) == 1:
            (poses,) = poses
        apart = all(isinstance(part, list) for pose in poses for part in pose)
    except (ValueError, TypeError, RecursionError):
        return []  # another language, or numbers that are in no lists
    if not apart:
        return []
    return [
        (count, re.findall(NUMBER, json.dumps(pose)))
        for count, pose in enumerate(poses, 1)
    ]


def points_in_list(path: Path, text: str, entry: str) -> Rows:
    """The points x, 0, z of a profile in YAML, where they are one list of numbers.

    Of several lists, `entry` names the profile. Raises ScanError.
    """
    lists = {match[1]: match for match in NAMED_LIST.finditer(text)}
    if not lists:
        return []
    profile = lists[chosen(path, lists, entry)]
    line = line_of(text, profile.start())
    fields = profile[2].split(",")
    return [(line, fields[first : first + 3]) for first in range(0, len(fields), 3)]
