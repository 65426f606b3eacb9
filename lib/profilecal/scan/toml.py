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
own.
"""

import json
import tomllib
from collections.abc import Callable, Collection, Mapping
from dataclasses import MISSING, fields, is_dataclass
from numbers import Integral, Real
from pathlib import Path
from typing import Annotated, Any

from profilecal.scan.tables import ScanError, naming, shown, text_of

# what a table in a file says, or fields of a Scan, by name
Entries = dict[str, Any]
# whether a value is allowed, and what is, in words
Rule = tuple[Callable[[Any], bool], str]


def number(low: float = 0.0, high: float = 1e6, kind: type = Real) -> Rule:
    """A number of a kind within these limits."""

    def allowed(value: Any) -> bool:
        is_number = isinstance(value, kind) and not isinstance(value, bool)
        return is_number and low <= value <= high

    return allowed, f"{low:g} to {high:g}"


def whole(low: int, high: int) -> Rule:
    """A whole number within these limits."""
    allowed, _ = number(low, high, Integral)
    return allowed, f"a whole number, {low} to {high}"


def numbers(count: int) -> Rule:
    """A list of so many finite numbers."""
    finite, _ = number(-1e6)

    def allowed(value: Any) -> bool:
        is_list = isinstance(value, list) and len(value) == count
        return is_list and all(map(finite, value))

    return allowed, f"{count} numbers"


def one_of(choices: Collection[Any]) -> Rule:
    """One of these; `TARGETS` may grow after it was made."""

    def allowed(value: Any) -> bool:
        return not isinstance(value, bool) and value in [*choices]

    return allowed, " or ".join(map(str, choices))


TABLE: Rule = (lambda value: isinstance(value, Mapping), "a table")
TEXT: Rule = (
    lambda value: isinstance(value, str) and value.isprintable() and len(value) <= 200,
    "one line of text",
)
Count = Annotated[int, whole(1, 10_000)]
# of fields that are annotated with a type alone
USUAL = {dict: TABLE, str: TEXT, int: whole(0, 10_000), float: number()}


def entries_of(table: Any) -> dict[str, Any]:
    """What the entries of a table may be, by name: a `Rule`, or the dataclass that
    describes a table of its own.
    """
    kinds: dict[str, Any] = {
        # what `Annotated` adds to a type, or the type
        entry.name: getattr(entry.type, "__metadata__", (entry.type,))[0]
        for entry in fields(table)
    }
    return {name: USUAL.get(kind, kind) for name, kind in kinds.items()}


def check_entries(
    path: str | Path,
    entries: Mapping[str, Any],
    described: Any,
    table: str = "",
    needed: Collection[str] = (),
) -> None:
    """Refuse entries of a file, or of a table in it, that are unknown or not allowed,
    and a file without those `needed`.

    The table is `described` by a dataclass, or by a dictionary as `entries_of` makes of
    one, in which a table of its own may be another dictionary. Raises ScanError.
    """
    where = f" in [{table}]" if table else ""
    if is_dataclass(described):
        every = fields(described)
        needed = [
            one.name for one in every if one.default is one.default_factory is MISSING
        ]
        described = entries_of(described)
    for name in needed:
        if name not in entries:
            raise ScanError(
                f"{path}: {name} is missing{where}; expected {described[name][1]}"
            )
    for name, value in entries.items():
        if name not in described:
            known = ", ".join(described) or "none"
            raise ScanError(
                f"{path}: unknown entry {shown(name)}{where}; there are {known}"
            )
        rule = described[name]
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
    path = Path(path)
    with naming(path):
        return tomllib.loads(text_of(path, megabytes=1))  # such a file is hand-written


def toml_text(entries: Mapping[str, Any]) -> str:
    """A dictionary of numbers, texts and nested lists of numbers, and one level of such
    dictionaries, as TOML.
    """
    tables = {name: table for name, table in entries.items() if isinstance(table, dict)}
    plain = {name: value for name, value in entries.items() if name not in tables}
    text = ""
    for name, table in ({"": plain} | tables).items():
        text += f"\n[{name}]\n" if name and table else ""
        for key, value in table.items():
            text += f"{key} = {json.dumps(value, ensure_ascii=False, default=float)}\n"
    return text
