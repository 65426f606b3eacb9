"""Scans in motion: in memory, in folders, and every mistake in them."""

from dataclasses import replace

import numpy as np
import pytest
from folders import assert_same, edited, removed, tabulated, written
from numpy.testing import assert_allclose
from simulated import scan_of

import profilecal as pc
from profilecal.geometry.log import Log
from profilecal.geometry.poses import homogeneous, rotations

SWEEPS = {"sweeps": 3, "profiles": 5, "turn_deg": 8.0}
T = homogeneous(np.eye(3), np.array([[400.0, 20 * t, 300] for t in range(4)]))
MOVED = {
    "points": [[1, 90], [2, 91], [1, 95]],
    "log": ([0, 1, 2, 3], T),
    "times": [1.0, 1.1, 1.2],
    "sweeps": np.array(["there"] * 3),
}


STOPS = {"motion": SWEEPS | {"stops": 4}}


def in_motion(kind="edge", **entries):
    return scan_of(kind, convention="KUKA angles", **{"motion": SWEEPS} | entries)


def since_1970(scan):
    log = replace(scan.log, t=scan.log.t + 1_764_000_000)
    return replace(scan, log=log, times=scan.times + 1_764_000_000)


def of_both_sides(scan):
    """With groups that are given."""
    sides = np.where(scan.moving, -1, np.resize([1, -1], len(scan.times)))
    return replace(scan, group_given=True, side=sides)


SCANS = {
    "other orientations": replace(
        pc.read_scan("data/examples/edge"), R_base_flange=[np.eye(3)] * 60
    ),
    "nothing seen": replace(in_motion(), values=[(), *in_motion().values[1:]]),
    "sweeps of profiles": in_motion("plane", mount="eye-to-hand"),
    "stops and sweeps": replace(in_motion("ball", **STOPS), delay_ms=12.5),
    "groups and sides": of_both_sides(in_motion("ball", **STOPS)),
    "times since 1970": since_1970(in_motion()),
    "numpy's names": pc.Scan.of("edge", **MOVED | {"delay_ms": np.int64(30)}),
}


@pytest.fixture
def folder(tmp_path):
    """A scan of sweeps and stops, as a folder."""
    pc.write_scan(in_motion(**STOPS), tmp_path / "scan")
    return tmp_path / "scan"


@pytest.mark.parametrize("name", SCANS)
def test_what_is_written_is_read(name, tmp_path):
    pc.write_scan(SCANS[name], tmp_path / "scan")
    assert_same(SCANS[name], pc.read_scan(tmp_path / "scan"))


def test_beside_a_log_poses_at_rest_have_no_times(folder):
    expected = pc.read_scan(folder)
    tabulated("poses.csv", lambda table: table.assign(t=1.0))(folder)
    assert_same(pc.read_scan(folder), expected)


def test_arrays_make_the_same_scan():
    scan = replace(in_motion(**STOPS), group_given=True)
    still = ~scan.moving
    made = pc.Scan.of(
        "edge",
        scan.T_base_flange[still],
        points=np.concatenate(scan.values),
        log=(scan.log.t, homogeneous(scan.log.R, scan.log.p)),
        times=scan.times,
        sweeps=scan.sweeps,
        labels=np.array(scan.labels)[still],
        group=[*"abcd"],
        title=scan.title,
        noise=scan.noise,
        convention=scan.convention,
    )
    assert_same(scan, made)
    assert repr(made) == (
        "Scan(edge, 4 poses of 4 orientations, 15 profiles in 3 sweeps, points, "
        "eye-in-hand)"
    )


@pytest.mark.parametrize(("rate", "mm", "deg"), [(100, 1e-5, 1e-5), (10, 0.02, 0.01)])
def test_a_log_is_followed_between_its_rows(rate, mm, deg):
    """To and fro by 20 mm and 5° in 2 s; beyond its ends, as before a gap, it goes on
    as it went. A row by itself says nothing; slow rows in a row do.
    """

    def way(t):
        phase = np.sin(np.pi * t)[:, None]
        turned = rotations(np.radians(5) * phase * [0, 0.6, 0.8])
        return turned, 20 * phase * [0.6, 0, 0.8] + [500, 0, 300]

    t = np.r_[0 : 4 : 1 / rate, 6.5, 9 : 13 : 1 / rate, 20:29]
    log = Log(t, *way(t))
    assert_allclose(log.away([6.5, 25]), [2.5, 0])
    times = np.concatenate([np.linspace(0.5, 3.4, 100), np.linspace(9.5, 12.4, 100)])
    R, p, _ = log.at(times)
    exact_R, exact_p = way(times)
    assert np.linalg.norm(p - exact_p, axis=1).max() < mm
    assert np.abs(R - exact_R).max() < np.radians(deg)
    R, p, _ = log.at(t[4 * rate - 1] + np.array([0, 0.1, 0.2]))
    assert 1 < np.linalg.norm(p[1] - p[0]) < 10
    assert_allclose(p[2] - p[1], p[1] - p[0], atol=1e-9)
    assert 1e-3 < np.abs(R[1] - R[0]).max() < 0.1
    assert_allclose(R[2] @ R[1].T, R[1] @ R[0].T, atol=1e-9)


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
    "points.csv line 6: pose '', sweep '', t 1.*expected either": edited(
        "points.csv", ",s1,1", ",,1"
    ),
    "points.csv line 2: pose 'p1', sweep 's9', t 3;.*either": edited(
        "points.csv", "p1,,", "p1,s9,3"
    ),
    "pose 'p1' is not in poses": removed("poses.csv"),
    "no columns 't'; expected one": edited("points.csv", "sweep,t", "sweep,time"),
    "delay_ms is -900 in .motion.; expected -200 to 200": edited(
        "scan.toml", "[noise]", "[motion]\ndelay_ms = -900\n\n[noise]"
    ),
    "found none among x, y, z, a, o, c": edited("log.csv", "a,b", "a,o"),
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
        ({"log": None}, "times given alone; expected times and log"),
        ({"times": None}, "log given alone; expected"),
        ({"times": [1, 2, np.inf]}, "there@inf is inf s from the nearest row"),
        ({"group": [7, 8, 9]}, r"group has shape \(3,\); expected \(0,\)"),
        ({"side": [1, -1, 1]}, "one for all that was seen in motion"),
        ({"sweeps": ["a", " ", "b"]}, "2 of 3 sweeps have a name"),
    ],
)
def test_wrong_arrays_are_named(entries, sentence):
    with pytest.raises(pc.ScanError, match=sentence):
        pc.Scan.of("edge", **MOVED | entries)


def test_a_log_has_times_though_the_robot_has_an_angle_t(tmp_path):
    """The orientations become quaternions."""
    scan = in_motion(**STOPS)
    pc.write_scan(replace(scan, convention="Kawasaki angles"), tmp_path / "scan")
    expected = replace(scan, convention="quaternion")
    assert_same(pc.read_scan(tmp_path / "scan"), expected)
