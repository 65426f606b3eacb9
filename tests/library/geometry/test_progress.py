"""Long loops can be watched."""

import pytest
from simulated import scan_of

import profilecal as pc
from profilecal.geometry.progress import watcher


@pytest.fixture
def passed():
    """What each loop is about, and how much of it has passed."""
    counts = {}

    def count(items, doing, total):
        for item in items:
            counts[doing] = counts.get(doing, 0) + 1
            yield item
        assert total in (None, counts[doing])

    token = watcher.set(count)
    yield counts
    watcher.reset(token)


def test_all_that_takes_long_passes_before_the_watcher(passed, tmp_path):
    size = {"groups": 8, "positions": 4, "measured": "profiles"}
    scan = scan_of("edge", seed=1, **size)
    pc.write_scan(scan, tmp_path / "scan")
    pc.self_test(pc.calibrate(pc.read_scan(tmp_path / "scan")), 10)
    parts = -(-sum(map(len, scan.values)) // 1000)
    assert passed == {
        "reading profiles.csv": parts,
        "looking for the target": 32,
        "simulating scans": 10,
    }
