"""Scans from a specification."""

import pytest
from command import run


def test_simulate_writes_a_scan_that_calibrates_to_its_truth(tmp_path):
    spec = tmp_path / "spec.toml"
    spec.write_text('kind = "disk"\nseed = 4\nconvention = "KUKA angles"\n[noise]\nprofile_mm = 0.02\n')
    assert run("simulate", spec, tmp_path / "scan").exit_code == 0
    assert (tmp_path / "scan" / "truth.toml").exists()
    assert run("calibrate", tmp_path / "scan").exit_code == 0
    again = run("simulate", spec, tmp_path / "scan")
    assert again.exit_code == 2
    assert "not empty; name a new folder" in again.output


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ('knid = "edge"', "unknown entry 'knid' in the specification; there are kind, title"),
        ('kind = "egde"', "kind is 'egde'; expected one of edge, disk"),
        ('kind = "edge"\ngroups = 2.5', "groups is 2.5 in the specification; expected int, zero or more"),
        ("[noise]\nprofile = 1", "unknown entry 'profile' in [noise]; there are profile_mm"),
        ('kind = "edge"\nmeasured = "chords"', "measured is 'chords'; expected one of profiles, points"),
        ("kind = ", "spec.toml: Invalid value"),
    ],
)
def test_a_wrong_specification_is_refused(tmp_path, text, sentence):
    (tmp_path / "spec.toml").write_text(text)
    result = run("simulate", tmp_path / "spec.toml", tmp_path / "scan")
    assert result.exit_code == 2
    assert sentence in result.output
    assert not (tmp_path / "scan").exists()
