"""What is written as TOML is read as it was."""

import tomllib

from profilecal.scan.toml import toml_text


def test_tables_and_lists_of_tables_come_back():
    entries = {
        "title": "a ü",
        "targets": [{"kind": "edge", "target": [1.5, 2, 3]}, {"kind": "ball"}],
        "noise": {"profile_mm": 0.05},
        "avoid": [[1, 2], [3, 4]],
        "empty": [],
    }
    assert tomllib.loads(toml_text(entries)) == entries
