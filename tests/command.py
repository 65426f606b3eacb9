"""The command line as a user calls it, and notebooks to give it."""

import signal
import subprocess
import time
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


def stopped(command, place, how, when):
    """What a command says that is stopped in `place` as soon as `when(process)`."""
    with subprocess.Popen(
        command,
        cwd=place,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # which what runs in the background ignores
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        end = time.monotonic() + 300
        while not when(process) and time.monotonic() < end and process.poll() is None:
            time.sleep(0.005)
        assert process.poll() is None, process.communicate()
        process.send_signal(how)
        _, said = process.communicate(timeout=30)
    assert process.returncode == (-how if how == signal.SIGKILL else 130)
    return said
