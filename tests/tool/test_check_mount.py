"""`profilecal check-mount`: its verdict, its exit status, its log."""

import numpy as np
from command import run
from simulated import moved, scan_of

import profilecal as pc
from profilecal_tool.words import mount_check_lines


def test_a_log_has_a_row_a_day_and_a_picture(tmp_path):
    answer, log = tmp_path / "T.json", tmp_path / "log.csv"
    pc.write_answer(pc.calibrate(scan_of("ball", seed=1, groups=10)), answer)
    again = scan_of("ball", seed=1, groups=10, scan=2)

    def checked(name, poses, shift, log):
        """What the command says of some poses, of arcs that are shifted along z."""
        arcs = np.concatenate(again.values[:poses]) + np.array([0, shift, 0])
        T = again.T_base_flange[:poses]
        few = pc.Scan.of("ball", T, arcs=arcs, radius=25)
        pc.write_scan(few, tmp_path / name)
        return run("check-mount", tmp_path / name, "--with", answer, "--log", log)

    assert checked("one", 3, 0, log).exit_code == 0
    moved = checked("two", 3, 5, log)
    assert moved.exit_code == 1
    assert "moved -5" in moved.output
    assert "that it is larger if the sensor alone has moved" in moved.output
    assert "along the sensor's z, and no other way" in moved.output
    single = checked("single", 1, 0, log)
    assert "left it, in the 3 of 6 directions that these poses test" in single.output
    assert "that it is larger if" not in checked("lone", 1, 5, log).output
    assert len(log.read_text().splitlines()) == 5
    assert (tmp_path / "log.png").stat().st_size > 10_000
    other = tmp_path / "other.csv"
    other.write_text("a,b\n1,2\n")
    assert checked("three", 3, 0, other).exit_code == 2
    assert other.read_text() == "a,b\n1,2\n"


def test_where_the_target_moved_nothing_is_said_of_the_sensor():
    again = scan_of("ball", seed=1, groups=10, scan=2)
    found = pc.calibrate(scan_of("ball", seed=1, groups=10))
    check = pc.check_mount(found, moved(again, -1.0))
    assert check.suspects == ("target",)
    assert "as if" not in dict(mount_check_lines(check, "ball"))


def test_a_check_that_could_show_nothing_has_a_status_of_its_own(tmp_path):
    options = {"groups": 6, "positions": 1, "noise": {"profile_mm": 0.05}}
    for number, name in ((1, "scan"), (2, "morning")):
        scan = scan_of("plane", seed=8, scan=number, **options)
        pc.write_scan(scan, tmp_path / name)
    answer = tmp_path / "T.json"
    answer.write_text(run("calibrate", tmp_path / "scan", "--json").output)
    result = run("check-mount", tmp_path / "morning", "--with", answer)
    assert result.exit_code == 2
    assert "verdict        none: only moves of more than 10 mm and 5°" in result.output
