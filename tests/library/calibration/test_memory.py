"""What memory there is, and scans that it does not hold."""

import pytest
from simulated import scan_of

import profilecal as pc
from profilecal.calibration import memory


def test_as_many_profiles_as_would_fit_are_solved(monkeypatch):
    monkeypatch.setattr(memory, "memory_limit", lambda: 1e6)
    sentence = (
        "250 profiles take 0.0024 GB of memory, of which there are 0.001; 103 would"
    )
    with pytest.raises(pc.ScanError, match=sentence):
        pc.calibrate(pc.simulate("edge", seed=1)[0])
    fitting = scan_of("edge", seed=1, groups=25, positions=4)
    assert pc.calibrate(fitting).status == "ok"


def test_the_limit_of_a_container_counts(tmp_path):
    limit = tmp_path / "sys/fs/cgroup/memory.max"
    of_machine = memory.memory_limit(tmp_path)
    assert of_machine > 1e8
    limit.parent.mkdir(parents=True)
    for text, bytes_allowed in (("max\n", of_machine), ("5000\n", 5000)):
        limit.write_text(text)
        assert memory.memory_limit(tmp_path) == bytes_allowed
