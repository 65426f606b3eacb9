"""A Dask worker that the tests of running notebooks share, which spares its start."""

import logging

import pytest


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
