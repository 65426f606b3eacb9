"""Every command says in one line what is wrong with a scan folder."""

import os
import tempfile
from pathlib import Path

import pytest
from command import run
from simulated import scan_of

import profilecal as pc

COMMANDS = {
    "calibrate": ["--json"],
    "check": [],
    "verify": ["--with", "T.json"],
}


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.skipif(
    os.name != "posix" or os.getuid() != 0, reason="gives up root's permissions"
)
def test_without_permission_a_command_says_so_and_writes_nothing(command):
    # not below pytest's folder, which is root's alone
    with tempfile.TemporaryDirectory() as above:
        os.chmod(above, 0o755)
        folder = Path(above) / "scan"
        pc.write_scan(scan_of("edge"), folder)
        arguments = [command, folder, *COMMANDS[command]]
        run(*arguments)  # which imports what root alone may read
        for locked, unread in (("poses.csv", "poses.csv"), (".", "scan.toml")):
            (folder / locked).chmod(0)
            os.seteuid(65534)
            try:
                done = run(*arguments)
            finally:
                os.seteuid(0)
            assert (done.exit_code, done.stdout) == (2, "")
            assert done.stderr == f"profilecal: {folder / unread}: Permission denied\n"


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_refuses_in_one_line_with_status_2(tmp_path, command):
    """`library/scan/test_folder.py` has all mistakes."""
    folder = tmp_path / "scan"
    pc.write_scan(scan_of("ball"), folder)
    (folder / "scan.toml").unlink()
    before = sorted(tmp_path.rglob("*"))
    done = run(command, folder, *COMMANDS[command])
    assert (done.exit_code, done.stdout) == (2, "")
    assert done.stderr.startswith("profilecal: ")
    assert done.stderr.count("\n") == 1
    assert sorted(tmp_path.rglob("*")) == before
