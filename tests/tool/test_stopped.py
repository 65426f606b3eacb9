"""What is stopped leaves nothing half-written, and says so where it can."""

import os
import signal
import sys
import time
from pathlib import Path

import numpy as np
from command import run, stopped
from numpy.random import default_rng

import profilecal as pc
from profilecal.scan.tables import partial_of

COMMAND = Path(sys.executable).with_name("profilecal")


def test_a_large_scan_is_imported_whole_or_not_at_all(tmp_path):
    """Of a folder of poses and profiles in one array. What `kill -9` leaves half
    written goes with the next attempt.
    """
    folder = tmp_path / "mine"
    folder.mkdir()
    rng = default_rng(2)
    np.save(folder / "profiles.npy", rng.uniform(50, 90, (40, 3_000, 2)))
    poses = np.pad(rng.uniform(300, 500, (40, 3)), [(0, 0), (0, 4)])
    poses[:, 3] = 1
    np.savetxt(
        folder / "poses.csv",
        poses,
        "%.3f",
        ",",
        header="x,y,z,qw,qx,qy,qz",
        comments="",
    )
    command = [COMMAND, "import", folder, "scan", "--target", "plane"]
    half = partial_of(partial_of(tmp_path / "scan"))  # a scan in what is imported

    def measurements_are_written(_):
        return any(half.glob("profiles.*"))

    said = stopped(command, tmp_path, signal.SIGTERM, measurements_are_written)
    assert os.listdir(tmp_path) == ["mine"]
    assert said == "\nInterrupted. Nothing was written.\n"
    stopped(command, tmp_path, signal.SIGKILL, measurements_are_written)
    assert half.exists()
    assert run("import", folder, tmp_path / "scan", "--target", "plane").exit_code == 0
    assert sorted(os.listdir(tmp_path)) == ["mine", "scan"]


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
