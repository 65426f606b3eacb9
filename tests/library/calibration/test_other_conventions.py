"""Poses read wrongly are named before the motions are blamed; poses read rightly are
left in peace.
"""

import re
from dataclasses import replace
from itertools import cycle

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation
from simulated import scan_of

from profilecal.calibration.calibration import calibrate
from profilecal.calibration.observe import observe
from profilecal.calibration.other_conventions import better_readings, observed
from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import inverse
from profilecal.scan.conventions import from_rotations, named, to_rotations
from profilecal.scan.folder import read_scan, write_scan
from profilecal.simulation.spec import Spec

SPECS = [
    Spec(kind="edge", groups=10, positions=4, seed=1),
    Spec(kind="disk", groups=10, positions=5, seed=2, mount="eye-to-hand"),
    Spec(
        kind="ball",
        groups=10,
        positions=3,
        seed=3,
        noise=Noise(profile_mm=0.05, position_mm=0.05),
    ),
    Spec(kind="plane", groups=15, positions=2, seed=4),
]


def inverted(scan):
    R, T = inverse(scan.R_base_flange, scan.p_base_flange)
    return replace(scan, R_base_flange=R, p_base_flange=T)


def on_another_mount(scan):
    return replace(
        scan, mount="eye-to-hand" if scan.mount == "eye-in-hand" else "eye-in-hand"
    )


def misread(name, printed_as, change=lambda block: block):
    """Orientations printed in one convention, changed, and read in another."""

    def wrong(scan):
        block = change(from_rotations(named(printed_as), scan.R_base_flange))
        return replace(
            scan,
            R_base_flange=to_rotations(named(name), block),
            convention=name,
            orientation=block,
        )

    return wrong


WRONG = {
    "FANUC angles w, p, r in degrees": misread("KUKA angles", "FANUC angles"),
    "KUKA angles a, b, c in degrees": misread("FANUC angles", "KUKA angles"),
    "Stäubli angles": misread("KUKA angles", "Stäubli angles"),
    "KUKA angles a, b, c in radians": misread("KUKA angles", "KUKA angles", np.radians),
    "FANUC angles w, p, r in radians": misread(
        "rotation vector", "FANUC angles", np.radians
    ),
    "a rotation vector in degrees": misread(
        "FANUC angles", "rotation vector", np.degrees
    ),
    "qw, qx, qy, qz read as x, y, z, w": misread(
        "quaternion", "quaternion", lambda q: q[:, [1, 2, 3, 0]]
    ),
    "every rotation inverted": misread(
        "matrix", "matrix", lambda block: block.reshape(-1, 3, 3).mT.reshape(-1, 9)
    ),
    "every pose inverted (base in flange)": inverted,
    'mount = "eye-': on_another_mount,
    "the poses' x, y, z in cm instead of mm": lambda s: replace(
        s, p_base_flange=s.p_base_flange / 10
    ),
    "taken from the next row's pose": lambda s: replace(
        s, values=(*s.values[1:], s.values[0])
    ),
    "taken from the previous row's pose": lambda s: replace(
        s, values=(s.values[0][:0], *s.values[:-1])
    ),
    "the poses' x, y, z in inches instead of mm": lambda s: replace(
        s, p_base_flange=s.p_base_flange / 25.4
    ),
}


@pytest.mark.parametrize(
    ("spec", "right"), list(zip(cycle(SPECS), WRONG, strict=False))
)
def test_what_was_read_wrongly_comes_first(spec, right):
    found = calibrate([WRONG[right](scan_of(spec))])
    assert found.status != "ok"
    assert found.messages[0].startswith("with ")
    assert right in found.messages[0]
    assert re.search(r"the residuals are 0\.0\d+ mm instead of", found.messages[0])
    assert found.misread
    assert not any(
        "add poses" in message or "tilt" in message for message in found.messages
    )


def test_a_scan_of_several_is_named_and_nothing_is_applied():
    scans = [
        replace(scan_of(spec), title=spec.kind)
        for spec in SPECS
        if spec.mount == "eye-in-hand"
    ]
    wrong = replace(on_another_mount(inverted(scans[1])), mount=scans[1].mount)
    found = calibrate([scans[0], wrong])
    assert found.messages[0].startswith(f'{wrong.title}: with mount = "eye-to-hand" or')
    assert found.scans == (scans[0], wrong)
    assert not any(
        message.startswith(f"{scans[0].title}: with") for message in found.messages
    )


@pytest.mark.parametrize(
    ("columns", "sequence", "words"),
    [
        (
            ("a", "b", "c"),
            "ZYZ",
            "a, b, c read as angles about z, the new y and the new z",
        ),
        (
            ("rx", "ry", "rz"),
            "xyz",
            "rx, ry, rz read as FANUC angles w, p, r in radians",
        ),
    ],
)
def test_columns_count_as_they_were_printed(tmp_path, columns, sequence, words):
    """The rotations alone do not tell them: a middle angle beyond 90°, a vector longer
    than π.
    """
    scan = scan_of(SPECS[2])
    over = Rotation.from_euler("xz", [180, 150], degrees=True).as_matrix()
    scan = replace(
        scan,
        R_base_flange=over @ scan.R_base_flange,
        p_base_flange=scan.p_base_flange @ over.T,
    )
    turned = Rotation.from_matrix(scan.R_base_flange).as_euler(sequence)
    assert (
        (turned[:, 1] > np.pi / 2).any()
        if sequence == "ZYZ"
        else (np.linalg.norm(turned, axis=1) > np.pi).any()
    )
    write_scan(scan, tmp_path / "scan")
    table = pd.read_csv(tmp_path / "scan" / "poses.csv").drop(
        columns=["qw", "qx", "qy", "qz"]
    )
    table[list(columns)] = np.degrees(turned) if columns[0] == "a" else turned
    table.to_csv(tmp_path / "scan" / "poses.csv", index=False)
    assert words in calibrate([read_scan(tmp_path / "scan")]).messages[0]


@pytest.mark.parametrize("spread_deg", [0.0, 1.0, 5.0])
@pytest.mark.parametrize("kind", ["edge", "ball", "plane"])
def test_poor_motions_are_blamed_on_no_reading(kind, spread_deg):
    scan = scan_of(Spec(kind=kind, groups=8, positions=4, spread_deg=spread_deg))
    assert not better_readings(scan, observe(scan))


def test_outliers_and_few_poses_are_blamed_on_no_reading():
    for spec in SPECS:
        scan, rng = scan_of(spec), np.random.default_rng(spec.seed)
        bad = rng.uniform(size=len(scan.values)) < 0.25
        values = tuple(
            v + 20 * b * rng.normal(size=v.shape[1])
            for v, b in zip(scan.values, bad, strict=True)
        )
        spoilt = replace(scan, values=values)
        assert not better_readings(spoilt, observe(spoilt))
        assert [
            len(observed(scan, observe(scan), k).labels) - len(scan.labels)
            for k in (0, 1, -1)
        ] == [0, -1, -1]
    few = scan_of(Spec(kind="ball", groups=3, positions=2, seed=1))
    assert not better_readings(few, observe(few))


def test_a_good_scan_never_pays(monkeypatch):
    monkeypatch.setattr("profilecal.calibration.calibration.better_readings", None)
    assert calibrate([scan_of(SPECS[0])]).status == "ok"
