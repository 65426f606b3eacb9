"""The command line as a user calls it, and notebooks to give it."""

import json
from pathlib import Path

from click.testing import CliRunner, Result

from profilecal_tool.cli import main

KERNEL = {"name": "python3", "language": "python", "display_name": "Python 3"}


def run(*arguments) -> Result:
    """The result of `profilecal` with these arguments."""
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


def write_notebook(path: Path, parameters: str, *codes: str) -> Path:
    """Write a notebook with a cell of parameters and cells of code."""
    cells = [
        {
            "cell_type": "code",
            "id": f"c{number}",
            "metadata": {"tags": [] if number else ["parameters"]},
            "source": source,
            "execution_count": None,
            "outputs": [],
        }
        for number, source in enumerate([parameters, *codes])
    ]
    notebook = {
        "cells": cells,
        "metadata": {"kernelspec": KERNEL},
        "nbformat": 4,
        "nbformat_minor": 5,
    }
    path.write_text(json.dumps(notebook))
    return path
