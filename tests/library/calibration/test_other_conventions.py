"""Poses read wrongly are named before the motions are blamed; poses read rightly are
left in peace.
"""

import re
from dataclasses import replace
from itertools import cycle

import numpy as np
import pytest
from numpy.random import default_rng
from scipy.spatial.transform import Rotation
from simulated import SCANNER, scan_of, with_values

import profilecal as pc
from profilecal.calibration.observe import observe
from profilecal.calibration.other_conventions import better_readings
from profilecal.geometry.poses import inverse
from profilecal.scan.conventions import from_rotations, named, to_rotations

ERRING = {"position_mm": 0.05}
EDGE = {"kind": "edge", "seed": 1, "groups": 10, "positions": 4}
DISK = {"kind": "disk", "seed": 2, "groups": 8, "positions": 4}
BALL = {"kind": "ball", "seed": 3, "groups": 10, "positions": 3, "noise": ERRING}
PLANE = {"kind": "plane", "seed": 4, "groups": 15, "positions": 2, "scanner": SCANNER}
SCANS = [EDGE, DISK | {"mount": "eye-to-hand"}, BALL, PLANE]


def inverted(scan):
    R, T = inverse(scan.R_base_flange, scan.p_base_flange)
    return replace(scan, R_base_flange=R, p_base_flange=T)


def on_another_mount(scan):
    others = {"eye-in-hand": "eye-to-hand", "eye-to-hand": "eye-in-hand"}
    return replace(scan, mount=others[scan.mount])


def misread(name, printed_as, change=lambda block: block):
    """Orientations printed in one convention, changed, and read in another."""

    def wrong(scan):
        block = change(from_rotations(named(printed_as), scan.R_base_flange))
        rotations = to_rotations(named(name), block)
        return replace(
            scan, R_base_flange=rotations, convention=name, orientation=block
        )

    return wrong


def one_row_early(scan):
    first, *others = scan.values
    return replace(scan, values=(*others, first))


WRONG = {  # by what the first message is to say
    "a rotation vector in degrees": misread(
        "FANUC angles", "rotation vector", np.degrees
    ),
    "qw, qx, qy, qz read as x, y, z, w": misread(
        "quaternion", "quaternion", lambda q: q[:, [1, 2, 3, 0]]
    ),
    "every rotation inverted": misread(
        "matrix", "matrix", lambda rows: rows.reshape(-1, 3, 3).mT.reshape(-1, 9)
    ),
    "every pose inverted (base in flange)": inverted,
    'mount = "eye-': on_another_mount,
    "taken from the next row's pose": one_row_early,
    "the profiles in reverse order": lambda scan: replace(
        scan, values=scan.values[::-1]
    ),
    "qw, qx, qy, qz read as z, w, x, y": misread(
        "quaternion", "quaternion", lambda q: q[:, [3, 0, 1, 2]]
    ),
}


# what is read does not depend on the target; these are the quickest
QUICK = cycle([EDGE, PLANE | {"mount": "eye-to-hand"}])


@pytest.mark.parametrize(("entries", "right"), [*zip(QUICK, WRONG, strict=False)])
def test_what_was_read_wrongly_is_said(entries, right):
    wrong = WRONG[right](scan_of(**entries))
    (said,) = better_readings(wrong, observe(wrong))
    assert said.startswith("with ")
    assert right in said
    assert re.search(r"the residuals are 0\.0\d+ mm instead of", said)


def test_it_comes_first_where_a_scan_of_several_is_named_and_nothing_is_applied():
    right = replace(scan_of(**EDGE), title="right")
    wrong = inverted(replace(scan_of(**EDGE, scan=2), title="wrong"))
    found = pc.calibrate([right, wrong])
    assert found.messages[0].startswith('wrong: with mount = "eye-to-hand" or')
    assert found.status != "ok"
    assert found.misread
    assert not re.search("add poses|tilt", " ".join(found.messages))
    assert found.scans == (right, wrong)
    assert not any(message.startswith("right: with") for message in found.messages)


@pytest.mark.parametrize(
    ("name", "sequence", "unit", "words"),
    [
        ("KUKA angles", "ZYZ", np.degrees(1), "a, b, c read as Kawasaki angles"),
        ("rotation vector", "xyz", 1, "rx, ry, rz read as FANUC angles w, p, r in rad"),
    ],
)
def test_angles_and_vectors_count_as_they_were_printed(name, sequence, unit, words):
    """Middle angles beyond 90° and vectors longer than π."""
    scan = scan_of(**EDGE)
    over = Rotation.from_euler("x", 90, degrees=True).as_matrix()
    angles = Rotation.from_matrix(over @ scan.R_base_flange).as_euler(sequence)
    length = np.linalg.norm(angles, axis=1)
    assert ((angles[:, 1] > np.pi / 2) | (length > np.pi)).any()
    read = replace(
        scan,
        R_base_flange=to_rotations(named(name), unit * angles),
        p_base_flange=scan.p_base_flange @ over.T,
        convention=name,
        orientation=unit * angles,
    )
    assert words in better_readings(read, observe(read))[0]


@pytest.mark.parametrize("spread_deg", [0.0, 1.0, 5.0])
@pytest.mark.parametrize("kind", ["edge", "ball", "plane"])
def test_poor_motions_are_blamed_on_no_reading(kind, spread_deg):
    for groups, positions in ((8, 4), (3, 2)):
        plan = {"groups": groups, "positions": positions, "spread_deg": spread_deg}
        scan = scan_of(kind, scanner=SCANNER, **plan)
        assert not better_readings(scan, observe(scan))


@pytest.mark.parametrize("seed", [1, 9, 33])
def test_what_few_poses_fit_by_chance_is_blamed_on_no_reading(seed):
    noise = {"position_mm": 0.5}
    scan = scan_of("edge", seed=seed, groups=6, positions=1, noise=noise)
    assert not better_readings(scan, observe(scan))


@pytest.mark.parametrize("entries", SCANS)
def test_outliers_are_blamed_on_no_reading(entries):
    scan, rng = scan_of(**entries), default_rng(entries["seed"])

    def shifted(rows):
        return rows + 20 * rng.normal(size=rows.shape[1])

    bad = np.flatnonzero(rng.uniform(size=len(scan.labels)) < 0.25)
    spoilt = with_values(scan, shifted, bad)
    assert not better_readings(spoilt, observe(spoilt))


def test_a_good_scan_never_pays(monkeypatch):
    monkeypatch.setattr("profilecal.calibration.calibrate.better_readings", None)
    assert pc.calibrate(scan_of(**EDGE)).status == "ok"
