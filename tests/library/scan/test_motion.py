"""Scans in motion: in memory, in folders, and every mistake in them."""

from dataclasses import replace

import numpy as np
import pytest
from folders import assert_same, edited, removed, tabulated, written
from numpy.testing import assert_allclose
from simulated import scan_of

import profilecal as pc
from profilecal.calibration.observe import observe
from profilecal.calibration.other_conventions import better_readings
from profilecal.geometry.log import Log
from profilecal.geometry.poses import homogeneous, rotations

SWEEPS = {"sweeps": 3, "profiles": 5, "turn_deg": 8.0}
RECORDED = {
    "sweeps of profiles": ("plane", {"motion": SWEEPS, "mount": "eye-to-hand"}),
    "stops and sweeps of arcs": ("ball", {"motion": SWEEPS | {"stops": 4}}),
}


T = homogeneous(np.eye(3), np.array([[400.0, 20 * t, 300] for t in range(4)]))
MOVED = {
    "points": [[1, 90], [2, 91], [1, 95]],
    "log": ([0, 1, 2, 3], T),
    "times": [1.0, 1.1, 1.2],
    "sweeps": np.array(["there"] * 3),
}


def in_motion(kind="edge", **entries):
    return scan_of(kind, convention="KUKA angles", **{"motion": SWEEPS} | entries)


@pytest.fixture
def folder(tmp_path):
    """A scan of sweeps and two stops, as a folder."""
    pc.write_scan(in_motion(motion=SWEEPS | {"stops": 2}), tmp_path / "scan")
    return tmp_path / "scan"


@pytest.mark.parametrize("name", RECORDED)
@pytest.mark.parametrize("delay_ms", [None, 12.5])
def test_what_is_written_is_read(name, delay_ms, tmp_path):
    kind, entries = RECORDED[name]
    scan = replace(in_motion(kind, **entries), delay_ms=delay_ms)
    pc.write_scan(scan, tmp_path / "scan")
    assert (tmp_path / "scan" / "poses.csv").exists() == ("stops" in name)
    assert_same(scan, pc.read_scan(tmp_path / "scan"))


def test_beside_a_log_poses_at_rest_have_no_times(folder):
    expected = pc.read_scan(folder)
    tabulated("poses.csv", lambda table: table.assign(t=[1.0, 2.0]))(folder)
    assert_same(pc.read_scan(folder), expected)


def test_arrays_make_the_same_scan():
    scan = in_motion(motion=SWEEPS | {"stops": 4})
    still = ~scan.moving
    names = [label for label, one in zip(scan.labels, still, strict=True) if one]
    made = pc.Scan.of(
        "edge",
        scan.T_base_flange[still],
        points=np.concatenate(scan.values),
        log=(scan.log.t, homogeneous(scan.log.R, scan.log.p)),
        times=scan.times,
        sweeps=scan.sweeps,
        labels=names,
        group=[*"abcd"],
        title=scan.title,
        noise=scan.noise,
        convention=scan.convention,
    )
    assert_same(scan, made)
    assert isinstance(better_readings(made.at_rest(3.0), observe(made)), list)
    assert repr(made) == (
        "Scan(edge, 4 poses of 4 orientations, 15 profiles in 3 sweeps, points, "
        "eye-in-hand)"
    )


def test_groups_and_sides_beside_sweeps_are_checked_and_come_back(folder):
    scan = in_motion("ball", motion=SWEEPS | {"stops": 4})
    still = ~scan.moving
    first = scan.group[still][0]
    together = np.where(still, first, scan.group)
    with pytest.raises(pc.ScanError, match="same label in group, by"):
        replace(scan, group=together, group_given=True)
    sides = np.where(still, np.resize([1, -1], len(still)), -1)
    given = replace(scan, group_given=True, side=sides)
    pc.write_scan(given, folder.with_name("given"))
    again = pc.read_scan(folder.with_name("given"))
    assert again.group_given
    assert_same(again, given)


def test_times_that_count_from_1970_keep_their_microseconds(tmp_path):
    scan = in_motion()
    log = replace(scan.log, t=scan.log.t + 1_764_000_000)
    late = replace(scan, log=log, times=scan.times + 1_764_000_000)
    pc.write_scan(late, tmp_path / "scan")
    read = pc.read_scan(tmp_path / "scan")
    assert np.abs(read.times - late.times).max() < 1e-6
    assert np.abs(read.p_base_flange - scan.p_base_flange).max() < 1e-3


@pytest.mark.parametrize(("rate", "mm", "deg"), [(100, 1e-5, 1e-5), (10, 0.02, 0.01)])
def test_a_log_is_followed_between_its_rows(rate, mm, deg):
    """To and fro by 20 mm and 5° in 2 s; a gap is not bridged."""

    def way(t):
        phase = np.sin(np.pi * t)[:, None]
        turned = rotations(np.radians(5) * phase * [0, 0.6, 0.8])
        return turned, 20 * phase * [0.6, 0, 0.8] + [500, 0, 300]

    t = np.concatenate([np.arange(0, 4, 1 / rate), np.arange(9, 13, 1 / rate)])
    log = Log(t, *way(t))
    times = np.linspace(0.5, 3.4, 200)
    R, p, twist = log.at(times)
    exact_R, exact_p = way(times)
    assert np.linalg.norm(p - exact_p, axis=1).max() < mm
    assert np.abs(R - exact_R).max() < np.radians(deg)
    h = 1e-5
    later, before = log.at(times + h), log.at(times - h)
    assert_allclose(twist[:, :3], (later[1] - before[1]) / (2 * h), atol=1e-4)
    turn = (later[0] - before[0]) @ R.mT / (2 * h)
    assert_allclose(twist[:, 5], turn[:, 1, 0], atol=1e-6)
    # beyond its end it goes on as it went
    last = t[len(t) // 2 - 1]
    _, p, twist = log.at(np.array([last, 4.1]))
    assert_allclose(p[1], p[0] + twist[0, :3] * (4.1 - last), atol=1e-9)


def swapped(table):
    """Two rows in the wrong order."""
    return table.iloc[[1, 0, *range(2, len(table))]]


MISTAKES = {
    "log.csv: log t is 0.5 in row 2; expected later": tabulated("log.csv", swapped),
    "the robot moves by 0.1.* mm/s at most.*in seconds": tabulated(
        "log.csv", lambda table: table.assign(t=1000 * table.t)
    ),
    "profile s3@.* is 59.3 s from the .*agree within 0.2 s": tabulated(
        "points.csv", lambda table: table.assign(t=table.t + 60)
    ),
    "points.csv line 4: pose '', sweep '', t 1.*expected either": edited(
        "points.csv", ",s1,1", ",,1"
    ),
    "points.csv line 2: pose 'p1', sweep 's9', t 3;.*either": edited(
        "points.csv", "p1,,", "p1,s9,3"
    ),
    "pose 'p1' is not in poses": removed("poses.csv"),
    "no columns 't'; expected one": edited("points.csv", "sweep,t", "sweep,time"),
    "delay_ms is 900 in .motion.; expected -200 to 200": edited(
        "scan.toml", "[noise]", "[motion]\ndelay_ms = 900\n\n[noise]"
    ),
    "log has 1 rows; expected two or more": written(
        "log.csv", "t,x,y,z,a,b,c\n1,500,0,0,0,0,0\n"
    ),
}


@pytest.mark.parametrize("sentence", MISTAKES)
def test_mistakes_are_named(sentence, folder):
    MISTAKES[sentence](folder)
    with pytest.raises(pc.ScanError, match=sentence):
        pc.read_scan(folder)


@pytest.mark.parametrize(
    ("entries", "sentence"),
    [
        ({"delay_ms": "30"}, "delay_ms is '30'; expected -200 to 200"),
        ({"delay_ms": np.nan}, "delay_ms is nan; expected -200 to 200"),
        ({"log": None}, "times without a log; expected both or neither"),
        ({"times": None}, "a log without times; expected both or neither"),
        ({"sweeps": ["a", " ", "b"]}, "2 of 3 sweeps have a name"),
    ],
)
def test_wrong_arrays_are_named(entries, sentence):
    with pytest.raises(pc.ScanError, match=sentence):
        pc.Scan.of("edge", **MOVED | entries)


def test_numpys_numbers_and_names_are_written_as_others(tmp_path):
    made = pc.Scan.of("edge", **MOVED | {"delay_ms": np.int64(30)})
    simulated, _ = pc.simulate("ball", radius=np.int64(20))
    for scan in (made, simulated):
        pc.write_scan(scan, tmp_path / scan.kind)
        assert_same(scan, pc.read_scan(tmp_path / scan.kind))


def test_a_log_has_times_though_the_robot_has_an_angle_t(tmp_path):
    """The orientations become quaternions."""
    scan = in_motion(motion=SWEEPS | {"stops": 2})
    pc.write_scan(replace(scan, convention="Kawasaki angles"), tmp_path / "scan")
    expected = replace(scan, convention="quaternion")
    assert_same(pc.read_scan(tmp_path / "scan"), expected)
