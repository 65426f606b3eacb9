"""TOML files whose entries are declared: which there are, and which values each may
have.

A frozen dataclass describes a table. Its fields are the entries; an annotation says
what one may be, where its type does not say enough::

    @dataclass(frozen=True)
    class Motion:
        pattern: Annotated[str, one_of(PATTERNS)] = "weave"
        sweeps: Count = 24
        lag_ms: float = 0.0

`check_entries("spec.toml", said, Motion, "motion")` refuses what the table cannot say.
A field without a default is needed; one annotated with a dataclass is a table of its
own. A plain float is 0 to 1e6, a plain int 0 to 10,000, and a str one line of text.
"""

import json
import tomllib
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from dataclasses import MISSING, fields
from numbers import Integral, Real
from pathlib import Path
from typing import Annotated, Any, get_type_hints

from profilecal.scan.tables import ScanError, listed, naming, shown, text_of

Entries = dict[str, Any]
# whether an entry may have a value, and what is expected, in words
Rule = tuple[Callable[[Any], bool], str]


def number(low: float = 0.0, high: float = 1e6, kind: type = Real) -> Rule:
    """A number of a kind within these limits."""

    def allowed(value: Any) -> bool:
        is_number = isinstance(value, kind) and not isinstance(value, bool)
        return is_number and low <= value <= high

    return allowed, f"{low:g} to {high:g}"


def whole(low: int, high: int) -> Rule:
    """A whole number within these limits."""
    allowed, limits = number(low, high, Integral)
    return allowed, f"a whole number, {limits}"


def numbers(count: int) -> Rule:
    """A list of so many finite numbers."""
    is_number, _ = number(-1e6, 1e6)

    def allowed(value: Any) -> bool:
        is_list = isinstance(value, list) and len(value) == count
        return is_list and all(map(is_number, value))

    return allowed, f"{count} numbers"


def one_of(choices: Collection[Any]) -> Rule:
    """One of these, though true is not 1; also of those that `choices` gains after it
    was made, as `TARGETS` may.
    """
    expected = " or ".join(map(str, choices))
    return (lambda value: value in [*choices] and value is not True), expected


TABLE = (lambda value: isinstance(value, Mapping)), "a table"
TEXT = (
    lambda value: isinstance(value, str) and value.isprintable() and len(value) <= 1000,
    "one line of text",
)
Count = Annotated[int, whole(1, 10_000)]
USUAL = {str: TEXT, int: whole(0, 10_000), float: number()}


def entries_of(table: type) -> Entries:
    """What the entries of a table may be, by name: a `Rule`, or the dataclass that
    describes a table of its own.
    """
    hints = get_type_hints(table, include_extras=True)
    return {
        name: getattr(hint, "__metadata__", [USUAL.get(hint, hint)])[0]
        for name, hint in hints.items()
    }


def check_entries(
    path: str | Path, entries: Mapping[str, Any], described: Any, table: str = ""
) -> None:
    """Refuse entries of a file, or of a table in it, that are unknown, not allowed or
    None, which stands for a missing one.

    The table is `described` by a dataclass, or by a dictionary as `entries_of` makes of
    one, in which a table of its own may be another dictionary. Raises ScanError.
    """
    rules = described
    if isinstance(described, type):
        rules = entries_of(described)
        own = fields(described)
        needed = [f.name for f in own if f.default is f.default_factory is MISSING]
        entries = dict.fromkeys(needed) | dict(entries)
    where = f" in [{table}]" if table else ""
    for name, value in entries.items():
        if name not in rules:
            raise ScanError(
                f"{path}: unknown entry {shown(name)}{where}; "
                f"there are {listed(rules) or 'none'}"
            )
        rule = rules[name]
        is_table = not isinstance(rule, tuple)
        allowed, expected = TABLE if is_table else rule
        if not allowed(value):
            raise ScanError(
                f"{path}: {name} is {shown(value)}{where}; expected {expected}"
            )
        if is_table:
            check_entries(path, value, rule, name)


def read_toml(path: str | Path) -> Entries:
    """The content of a TOML file. Raises ScanError."""
    with naming(path):
        return tomllib.loads(text_of(Path(path), megabytes=1))


def toml_text(entries: Mapping[str, Any]) -> str:
    """A dictionary of finite numbers, texts and nested lists of numbers, and one level
    of such dictionaries, as TOML, without those that are empty.

    Raises ValueError for what would not be read back as it is: None, deeper levels,
    names that are more than letters, digits, - and _.
    """
    plain = json.loads(json.dumps(entries, allow_nan=False, default=float))
    full = {name: value for name, value in plain.items() if value != {}}
    text = tables = ""
    for name, value in full.items():
        if isinstance(value, dict):
            tables += f"\n[{name}]\n{toml_text(value)}"
        else:
            text += f"{name} = {json.dumps(value, ensure_ascii=False)}\n"
    text += tables
    with suppress(tomllib.TOMLDecodeError):
        if tomllib.loads(text) == full:
            return text
    raise ValueError(f"{shown(plain)} cannot be written as TOML")
