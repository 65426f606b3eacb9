"""What is stopped leaves nothing half-written, and says so where it can."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from numpy.random import default_rng
from simulated import scan_of

import profilecal as pc
from profilecal.scan.tables import partial_of

COMMAND = Path(sys.executable).with_name("profilecal")
WRITE = """
import numpy as np
import profilecal as pc

poses = np.tile(np.eye(4), (20, 1, 1))
poses[:, :3, 3] = np.random.default_rng(0).uniform(300, 500, (20, 3))
profiles = np.random.default_rng(1).uniform(50, 90, (20, 10_000, 2))
print("begins", flush=True)
pc.write_scan(pc.Scan.of("plane", poses, profiles=profiles), "scan")
"""


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
        end = time.monotonic() + 60
        while not when(process) and time.monotonic() < end and process.poll() is None:
            time.sleep(0.005)
        assert process.poll() is None, process.communicate()
        process.send_signal(how)
        _, said = process.communicate(timeout=30)
    assert process.returncode != 0
    return said


def half_written(folder):
    """What tells whether writing a folder has got to its measurements."""
    partial = partial_of(folder)
    return lambda _: any(partial.glob("profiles.*"))


def test_a_large_scan_is_written_whole_or_not_at_all(tmp_path):
    folder = tmp_path / "scan"
    command = [sys.executable, "-c", WRITE]
    stopped(command, tmp_path, signal.SIGKILL, half_written(folder))
    assert not folder.exists()
    assert partial_of(folder).exists()
    pc.write_scan(scan_of("plane", measured="profiles"), folder)
    assert len(pc.read_scan(folder).values) > 0
    assert os.listdir(tmp_path) == ["scan"]


def test_import_leaves_nothing(tmp_path):
    """Of a folder of poses and profiles in one array."""
    folder = tmp_path / "mine"
    folder.mkdir()
    rng = default_rng(2)
    np.save(folder / "profiles.npy", rng.uniform(50, 90, (40, 10_000, 2)))
    poses = np.pad(rng.uniform(300, 500, (40, 3)), [(0, 0), (0, 4)])
    poses[:, 3] = 1
    names = "x,y,z,qw,qx,qy,qz"
    np.savetxt(folder / "poses.csv", poses, "%.3f", ",", header=names, comments="")
    command = [COMMAND, "import", folder, "scan", "--target", "plane"]
    when = half_written(partial_of(tmp_path / "scan"))
    said = stopped(command, tmp_path, signal.SIGTERM, when)
    assert os.listdir(tmp_path) == ["mine"]
    assert said == "\nInterrupted. Nothing was written.\n"


def test_a_stopped_report_leaves_the_old_one_and_the_answer(tmp_path):
    pc.write_scan(pc.simulate("edge", groups=8, positions=5)[0], tmp_path / "scan")
    report = tmp_path / "report.html"
    report.write_text("old")
    command = [COMMAND, "calibrate", "scan", "--report", "report.html"]

    def answer_is_printed(process):
        printed = process.stdout.readline().startswith("robot errors")
        time.sleep(printed)  # until the notebook is at work
        return printed

    said = stopped(command, tmp_path, signal.SIGINT, answer_is_printed)
    assert report.read_text() == "old"
    assert sorted(os.listdir(tmp_path)) == ["report.html", "scan"]
    # a kernel that was about to start may complain afterwards
    assert "Interrupted. report.html was not written.\n" in said
