"""What is written as TOML is read as it was."""

import tomllib

from profilecal.scan.toml import toml_text


def test_tables_and_lists_come_back():
    entries = {
        "title": "a ü",
        "target": {"kind": "edge", "point": [1.5, 2, 3]},
        "noise": {"profile_mm": 0.05},
        "avoid": [[1, 2], [3, 4]],
        "empty": [],
    }
    assert tomllib.loads(toml_text(entries)) == entries
