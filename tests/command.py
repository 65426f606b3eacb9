"""The command line, as a user calls it, and small notebooks to give it."""

import json
from pathlib import Path

from click.testing import CliRunner

from profilecal.cli import main


def run(*arguments):
    """The result of `profilecal` with these arguments."""
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


def write_notebook(path: Path, parameters: str, *codes: str) -> Path:
    """A notebook with a cell of parameters and cells of code."""
    cells = [
        {"cell_type": "code", "id": f"c{k}", "metadata": {"tags": tags}, "source": source}
        for k, (source, tags) in enumerate([(parameters, ["parameters"]), *[(code, []) for code in codes]])
    ]
    for cell in cells:
        cell.update(execution_count=None, outputs=[])
    kernel = {"kernelspec": {"name": "python3", "language": "python", "display_name": "Python 3"}}
    path.write_text(json.dumps({"cells": cells, "metadata": kernel, "nbformat": 4, "nbformat_minor": 5}))
    return path
