"""What makers.toml says: robots' lines, titles of columns, units, codes."""

from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from profilecal.scan.conventions import CONVENTIONS
from profilecal.scan.tables import ScanError, listed
from profilecal.scan.toml import check_entries, read_toml

XYZ = tuple("xyz")
OF_POSES = {*XYZ, *(name for one in CONVENTIONS for name in one.columns)}
PATH = Path(__file__).with_name("makers.toml")
TABLE = read_toml(PATH)
LENGTH_UNITS = TABLE["lengths"]
ANGLE_UNITS = TABLE["angles"]
TIME_UNITS = TABLE["times"]
ENCODINGS = TABLE["encodings"]
UNITS = LENGTH_UNITS | ANGLE_UNITS | TIME_UNITS
UNIT_OF_CODE = {float(code): unit for code, unit in TABLE["nothing_seen"].items()}
WORDS = {name: {*words.split()} for name, words in TABLE["words"].items()}
ROLE_OF_TITLE = {
    title: role
    for role, words in TABLE["titles"].items()
    for title in (role, *words.split())
} | {name: name for name in OF_POSES}
FOREIGN = {word for word in (*ROLE_OF_TITLE, *UNITS) if not word.isascii()}


def roles_by_word(lists: dict[str, str]) -> dict[tuple[str, int], list[list[str]]]:
    """The roles of a list's numbers, by its word and by how many they are; there may be
    several.
    """
    found = defaultdict(list)
    for line, words in lists.items():
        roles = line.split()
        for word in words.split():
            found[word, len(roles)].append(roles)
    return found


ROLES_OF_LIST = roles_by_word(TABLE["lists"])


def are_pairs(value: list) -> bool:
    """Whether what a row says is a list of pairs."""
    return all(isinstance(pair, list) and len(pair) == 2 for pair in value)


Pairs = Annotated[list, (are_pairs, '[["one text", "its example, or end"], …]')]


@dataclass(frozen=True)
class Robot:
    """A row of [[robot]]; the head of makers.toml says what each key is."""

    maker: str
    pose: Pairs  # of a line's form and an example, as all further lines
    has: str = ""
    remarks: Pairs = ()  # of their begin and end
    unit: str = "mm"
    tool: Pairs = ()
    tools_in: str = "tool"
    base: Pairs = ()
    uses: Pairs = ()
    beside: Pairs = ()


def robot_of(row: dict) -> Robot:
    """The robot of a row. Raises ScanError for a key that is missing or unknown, or has
    no list of pairs, with the maker and what is expected.
    """
    check_entries(f"{PATH}: robot {row.get('maker', '')!r}", row, Robot)
    return Robot(**row)


ROBOTS = {robot.maker: robot for robot in map(robot_of, TABLE["robot"])}


def scale_of(
    place: Any, units: set[str], usual: str, among: dict[str, float]
) -> tuple[float, str]:
    """The one unit of several columns, the usual one if they have none: its scale, and
    its name. `among`: the units of lengths, angles or times, with their scales.

    Raises ScanError.
    """
    unit, *others = units or {usual}
    if others or unit not in among:
        raise ScanError(
            f"{place}: units are {listed(sorted(units))}; "
            f"expected one of {listed(filter(str.isascii, among))}"
        )
    return among[unit], unit
