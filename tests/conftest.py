"""Dask workers that the tests of running notebooks share, which spares their start."""

import logging

import pytest


@pytest.fixture(scope="module")
def cluster():
    """Two Dask workers, processes as a sweep starts them."""
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        memory_limit=None,
        dashboard_address="127.0.0.1:0",
        silence_logs=logging.CRITICAL,
    ) as workers:
        yield workers
