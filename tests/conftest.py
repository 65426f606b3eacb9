"""What spares time: a Dask worker that the tests of running notebooks share, and poses
that are read in one way alone.
"""

import logging

import pytest


@pytest.fixture
def read_rightly(monkeypatch):
    """No other reading is tried, which takes most of the time of an answer that is not
    "ok", and which `test_other_conventions.py` tests.
    """
    name = "profilecal.calibration.calibrate.better_readings"
    monkeypatch.setattr(name, lambda *_: [])


@pytest.fixture(scope="module")
def cluster():
    """A Dask worker, a thread here: its kernels start as those of `quick_start` do."""
    from distributed import LocalCluster

    with LocalCluster(
        processes=False,
        n_workers=1,
        threads_per_worker=1,
        memory_limit=None,
        protocol="tcp",
        dashboard_address="127.0.0.1:0",
        silence_logs=logging.CRITICAL,
    ) as worker:
        yield worker
