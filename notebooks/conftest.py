"""Notebooks on measurements that the repository does not hold are compared where a user has them."""

import os

import pytest

REAL_DATA = "PROFILECAL_REAL_DATA"


def pytest_collection_modifyitems(items):
    if not os.environ.get(REAL_DATA):
        for item in items:
            if item.path.name == "61_real_scanner.ipynb":
                item.add_marker(pytest.mark.skip(reason=f"{REAL_DATA} is not set: see data/README.md"))
