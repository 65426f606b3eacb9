"""TOML files whose entries are declared: which there are, and which values each may
have.
"""

import json
import tomllib
from collections.abc import Callable
from pathlib import Path

from profilecal.scan.scan import ScanError
from profilecal.scan.tables import naming, shown, text_of

# whether a value is allowed, and what is, in words
Rule = tuple[Callable[[object], bool], str]

TABLE: Rule = (lambda value: isinstance(value, dict), "a table")
TEXT: Rule = (
    lambda value: isinstance(value, str) and value.isprintable() and len(value) <= 200,
    "one line of text",
)


def number(low: float = 0.0, high: float = 1e6) -> Rule:
    """A number within these limits."""

    def allowed(value):
        return (
            isinstance(value, int | float)
            and not isinstance(value, bool)
            and low <= value <= high
        )

    return allowed, f"{low:g} to {high:g}"


def whole(low: int = 0, high: int = 1_000_000) -> Rule:
    """A whole number within these limits."""
    return (
        lambda value: type(value) is int and low <= value <= high,
        f"a whole number, {low} to {high}",
    )


def numbers(count: int) -> Rule:
    """A list of so many finite numbers."""
    finite, _ = number(-1e6)
    return (
        lambda value: (
            isinstance(value, list) and len(value) == count and all(map(finite, value))
        ),
        f"{count} numbers",
    )


def one_of(choices) -> Rule:
    """One of these."""
    choices = tuple(choices)
    return lambda value: value in choices and not isinstance(value, bool), " or ".join(
        map(str, choices)
    )


def check_entries(
    path, entries: dict, rules: dict[str, Rule | dict], table: str = "", needed=()
) -> dict:
    """The entries of a file, or of a table in it, if all are known and allowed, and
    those `needed` are there; a dict of rules is a table's. Raises ScanError.
    """
    where = f" in [{table}]" if table else ""
    for name in needed:
        if name not in entries:
            raise ScanError(
                f"{path}: {name} is missing{where}; expected {rules[name][1]}"
            )
    for name, value in entries.items():
        if name not in rules:
            raise ScanError(
                f"{path}: unknown entry {shown(name)}{where}; there are {', '.join(rules)}"
            )
        inner = isinstance(rules[name], dict)
        allowed, expected = TABLE if inner else rules[name]
        if not allowed(value):
            raise ScanError(
                f"{path}: {name} is {shown(value)}{where}; expected {expected}"
            )
        if inner:
            check_entries(path, value, rules[name], name)
    return entries


def read_toml(path) -> dict:
    """The content of a TOML file. Raises ScanError."""
    path = Path(path)
    with naming(path):
        # such a file is written by hand
        return tomllib.loads(text_of(path, megabytes=1))


def toml_text(entries: dict) -> str:
    """A dictionary of numbers, texts and nested lists of numbers, and one level of such
    dictionaries, as TOML.
    """
    text, tables = (
        "",
        {name: table for name, table in entries.items() if isinstance(table, dict)},
    )
    for name, table in (
        {"": {key: entries[key] for key in entries if key not in tables}} | tables
    ).items():
        text += f"\n[{name}]\n" if name and table else ""
        for key, value in table.items():
            text += f"{key} = {json.dumps(value, ensure_ascii=False)}\n"
    return text
