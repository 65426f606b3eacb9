"""`profilecal check-mount`: its verdict, its exit status, its log."""

import numpy as np
from command import run
from simulated import scan_of

import profilecal as pc


def test_a_log_has_a_row_a_day_and_a_picture(tmp_path):
    scan = scan_of("ball", seed=1, groups=10)
    pc.write_scan(scan, tmp_path / "scan")
    answer, log = tmp_path / "T.json", tmp_path / "log.csv"
    answer.write_text(run("calibrate", tmp_path / "scan", "--json").output)
    again = scan_of("ball", seed=1, groups=10, scan=2)
    T = again.T_base_flange[:3]
    statuses = []
    for day, shift in (("one", 0.0), ("two", 5.0)):
        arcs = np.concatenate(again.values[:3]) + np.array([0, shift, 0])
        pc.write_scan(pc.Scan.of("ball", T, arcs=arcs, radius=25), tmp_path / day)
        options = ("--with", answer, "--log", log)
        result = run("check-mount", tmp_path / day, *options)
        statuses.append(result.exit_code)
    assert statuses == [0, 1]
    assert "moved -5" in result.output
    assert "along the sensor's z, and no other way" in result.output
    assert len(log.read_text().splitlines()) == 3
    assert (tmp_path / "log.png").stat().st_size > 10_000
    other = tmp_path / "other.csv"
    other.write_text("a,b\n1,2\n")
    result = run("check-mount", tmp_path / "one", "--with", answer, "--log", other)
    assert result.exit_code == 2
    assert other.read_text() == "a,b\n1,2\n"
    picture = tmp_path / "other.png"
    result = run("check-mount", tmp_path / "one", "--with", answer, "--log", picture)
    assert result.exit_code == 2
    assert f"--log is {picture}; expected a name that ends in .csv" in result.stderr
    assert not picture.exists()
    one = pc.Scan.of("ball", T[:1], arcs=again.values[0], radius=25)
    pc.write_scan(one, tmp_path / "single")
    result = run("check-mount", tmp_path / "single", "--with", answer)
    assert "left it, in the 3 of 6 directions that these poses test" in result.output


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
