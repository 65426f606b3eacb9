"""A Dask worker that the tests of running notebooks share, which spares its start."""

import logging

import pytest


@pytest.fixture(scope="module")
def cluster():
    """A Dask worker, a process as a sweep starts them."""
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=1,
        threads_per_worker=1,
        memory_limit=None,
        dashboard_address="127.0.0.1:0",
        silence_logs=logging.CRITICAL,
    ) as worker:
        yield worker
