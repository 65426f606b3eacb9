"""The command line, as a user calls it, small notebooks to give it, and files with
changes.
"""

import json
from pathlib import Path

from click.testing import CliRunner

from profilecal_tool.cli import main


def run(*arguments):
    """The result of `profilecal` with these arguments."""
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


def write_notebook(path: Path, parameters: str, *codes: str) -> Path:
    """A notebook with a cell of parameters and cells of code."""
    cells = [
        {
            "cell_type": "code",
            "id": f"c{k}",
            "metadata": {"tags": tags},
            "source": source,
        }
        for k, (source, tags) in enumerate(
            [(parameters, ["parameters"]), *[(code, []) for code in codes]]
        )
    ]
    for cell in cells:
        cell.update(execution_count=None, outputs=[])
    kernel = {
        "kernelspec": {
            "name": "python3",
            "language": "python",
            "display_name": "Python 3",
        }
    }
    path.write_text(
        json.dumps(
            {"cells": cells, "metadata": kernel, "nbformat": 4, "nbformat_minor": 5}
        )
    )
    return path


def edited(name: str, old: str, new: str, count: int = 1):
    """A change of a folder: in the text of a file, from something that is there."""

    def change(folder: Path) -> None:
        content = (folder / name).read_text()
        assert old in content
        (folder / name).write_text(content.replace(old, new, count))

    return change
