"""The command line as such: its help, and what it sets before anything loads."""

import os
import subprocess
import sys

import pytest
from command import run

from profilecal_tool.cli import main

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@pytest.mark.parametrize("command", ["", *main.commands])
def test_help_fits_a_screen(command, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    for option in ("--help", "-h", *(["--version"] if not command else [])):
        shown = run(*filter(None, [command]), option)
        assert shown.exit_code == 0
        assert len(shown.output.splitlines()) <= 24


@pytest.mark.parametrize("given", [{}, {"OPENBLAS_NUM_THREADS": "3"}])
def test_one_thread_unless_the_environment_says_otherwise(given):
    code = (
        "import os, sys\n"
        "from profilecal_tool.cli import main\n"
        f"main.command('look')(lambda: print('numpy' in sys.modules, [os.environ[name] for name in {THREADS}]))\n"
        "main(['look'])"
    )
    environment = {
        name: value for name, value in os.environ.items() if name not in THREADS
    } | given
    said = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env=environment,
    )
    assert said.stdout == f"False {[given.get(name, '1') for name in THREADS]}\n"
