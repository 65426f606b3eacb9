"""The command line as such: its help, and what it needs and sets before it begins."""

import os
import subprocess
import sys

import pytest
from command import run

from profilecal_tool.cli import main

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
WITHOUT_PACKAGES = """
import sys
sys.modules.update(dict.fromkeys({missing}))
sys.argv = ["profilecal", "--version"]
from profilecal_tool.__main__ import main
main()
"""
THREADS_IN_A_COMMAND = f"""
import os, sys
from profilecal_tool.cli import main

@main.command()
def look():
    print("numpy" in sys.modules, *[os.environ[name] for name in {THREADS}])

main(["look"])
"""


def python(code, environment=None):
    """What a fresh interpreter makes of some code."""
    command = [sys.executable, "-c", code]
    return subprocess.run(command, capture_output=True, text=True, env=environment)


@pytest.mark.parametrize("option", ["--help", "-h"])
@pytest.mark.parametrize("command", [(), *zip(main.commands)])
def test_the_help_fits_a_screen(command, option, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    shown = run(*command, option)
    assert shown.exit_code == 0
    assert len(shown.output.splitlines()) <= 24


@pytest.mark.parametrize("given", [{}, {"OPENBLAS_NUM_THREADS": "3"}])
def test_one_thread_unless_the_environment_says_otherwise(given):
    environment = dict(os.environ)
    for name in THREADS:
        environment.pop(name, None)
    shown = python(THREADS_IN_A_COMMAND, environment | given)
    numbers = [given.get(name, "1") for name in THREADS]
    assert shown.stdout.split() == ["False", *numbers], shown.stderr


def test_without_its_packages_the_command_says_how_to_install_them():
    ended = python(WITHOUT_PACKAGES.format(missing=["pandas", "click"]))
    assert (ended.returncode, ended.stdout) == (2, "")
    sentence = 'the command needs click, pandas: pip install "profilecal[tool]"'
    assert ended.stderr == f"profilecal: {sentence}\n"
