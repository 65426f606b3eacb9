"""The command line as a user calls it, and notebooks to give it."""

from pathlib import Path

import nbformat
from click.testing import CliRunner, Result
from nbformat.v4 import new_code_cell, new_notebook

from profilecal_tool.cli import main

KERNEL = {"name": "python3", "language": "python", "display_name": "Python 3"}


def run(*arguments) -> Result:
    """The result of `profilecal` with these arguments."""
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


def write_notebook(path: Path, parameters: str, *codes: str) -> Path:
    """Write a notebook with a cell of parameters and cells of code."""
    cells = [new_code_cell(source) for source in (parameters, *codes)]
    cells[0].metadata["tags"] = ["parameters"]
    nbformat.write(new_notebook(cells=cells, metadata={"kernelspec": KERNEL}), path)
    return path
