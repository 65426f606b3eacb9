"""TOML files whose entries are declared: which there are, and which values each may
have.
"""

import json
import tomllib
from collections.abc import Callable, Collection, Iterable, Mapping
from numbers import Integral, Real
from pathlib import Path
from typing import Any

from profilecal.scan.tables import ScanError, naming, shown, text_of

# whether a value is allowed, and what is, in words
Rule = tuple[Callable[[Any], bool], str]


def is_line(value: Any) -> bool:
    """Whether a value is one line of text, not too long."""
    return isinstance(value, str) and value.isprintable() and len(value) <= 200


TABLE: Rule = (lambda value: isinstance(value, dict), "a table")
TEXT: Rule = (is_line, "one line of text")


def number(low: float = 0.0, high: float = 1e6, kind: type = Real) -> Rule:
    """A number of a kind within these limits."""

    def allowed(value: Any) -> bool:
        is_number = isinstance(value, kind) and not isinstance(value, bool)
        return is_number and low <= value <= high

    return allowed, f"{low:g} to {high:g}"


def whole(low: int = 0, high: int = 1_000_000) -> Rule:
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


def one_of(choices: Iterable[Any]) -> Rule:
    """One of these."""
    known = tuple(choices)

    def allowed(value: Any) -> bool:
        return not isinstance(value, bool) and value in known

    return allowed, " or ".join(map(str, known))


def check_entries(
    path: str | Path,
    entries: Mapping[str, Any],
    rules: Mapping[str, Any],
    table: str = "",
    needed: Collection[str] = (),
) -> None:
    """Refuse entries of a file, or of a table in it, that are unknown or not allowed,
    and a file without those `needed`.

    `rules` has a `Rule` for each entry, or the rules of a table. Raises ScanError.
    """
    where = f" in [{table}]" if table else ""
    for name in needed:
        if name not in entries:
            expected = rules[name][1]
            raise ScanError(f"{path}: {name} is missing{where}; expected {expected}")
    for name, value in entries.items():
        if name not in rules:
            known = ", ".join(rules) or "none"
            unknown = f"unknown entry {shown(name)}{where}"
            raise ScanError(f"{path}: {unknown}; there are {known}")
        inner = isinstance(rules[name], dict)
        allowed, expected = TABLE if inner else rules[name]
        if not allowed(value):
            said = f"{name} is {shown(value)}{where}"
            raise ScanError(f"{path}: {said}; expected {expected}")
        if inner:
            check_entries(path, value, rules[name], name)


def read_toml(path: str | Path) -> dict[str, Any]:
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
            text += f"{key} = {json.dumps(value, ensure_ascii=False)}\n"
    return text
