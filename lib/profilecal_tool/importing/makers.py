"""What makers.toml says: robots' lines, titles of columns, units, codes."""

import tomllib
from collections import defaultdict
from importlib.resources import files

from profilecal.scan.conventions import CONVENTIONS

TABLE = tomllib.loads(files(__package__).joinpath("makers.toml").read_text("utf-8"))
ROBOTS = {robot["maker"]: robot for robot in TABLE["robot"]}
LENGTHS = TABLE["lengths"]
ANGLE_UNITS = TABLE["angles"]
UNITS = LENGTHS | ANGLE_UNITS
CODES = {float(code): unit for code, unit in TABLE["scanners"].items()}
SETS = {name: {*words.split()} for name, words in TABLE["words"].items()}
ROLES = {}  # by title
for role, words in TABLE["titles"].items():
    ROLES |= dict.fromkeys([role, *words.split()], role)
ROLES |= {name: name for one in CONVENTIONS for name in one.columns}
FOREIGN = {word for word in (*ROLES, *UNITS) if not word.isascii()}
LISTS = defaultdict(list)  # roles by a list's word and how many numbers it has
for roles, words in TABLE["lists"].items():
    for word in words.split():
        LISTS[word, len(roles.split())].append(roles.split())
