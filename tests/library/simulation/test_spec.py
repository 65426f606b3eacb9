"""Scans from a specification."""

import pytest
from command import run

import profilecal as pc


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ('knid = "edge"', "unknown entry 'knid'; there are kind, title"),
        ("groups = 2.5", "groups is 2.5; expected a whole number, 0 to 10000"),
        (
            "[scanner]\nnear = 260\nfar = 40",
            "in [scanner] expected 0 <= near < far, near_width > 0",
        ),
        ('measured = "chords"', "measured is 'chords'; expected profiles or points"),
        (
            'poses = "poses.csv"\n[guess]\ntarget = [1, 2, 3]',
            "mount is missing in [guess]; expected 6 numbers",
        ),
        ("kind = ", "Invalid value"),
        ('kind = "point"\n[motion]', "a point is not swept; leave [motion] out"),
    ],
)
def test_a_wrong_specification_is_refused(tmp_path, text, sentence):
    (tmp_path / "spec.toml").write_text(text)
    result = run("simulate", tmp_path / "spec.toml", tmp_path / "scan")
    assert result.exit_code == 2
    assert f"spec.toml: {sentence}" in result.output
    assert not (tmp_path / "scan").exists()


IMPOSSIBLE = {
    "the arm's wrist is up to": {
        "robot": {"joint_deg": 0.1},
        "seed": 12,
        "mount": "eye-to-hand",
    },
    "the robot moves by .* mm/s at most": {
        "motion": {"pattern": "random", "speed": 1.0, "sweeps": 1},
        "seed": 2,
    },
    "none of these poses is anything seen": {
        "motion": {"dropped_percent": 90, "profiles": 1, "sweeps": 1}
    },
    "link_mm has no effect": {"motion": {}, "robot": {"link_mm": 0.2}},
    "accuracy_mm has no effect": {"noise": {"accuracy_mm": 0.3}},
    "steering_mm has no effect": {"motion": {}, "noise": {"steering_mm": 0.3}},
}


@pytest.mark.parametrize("sentence", IMPOSSIBLE)
def test_what_no_robot_does_is_refused(sentence):
    with pytest.raises(pc.ScanError, match=sentence):
        pc.simulate("edge", **IMPOSSIBLE[sentence])
