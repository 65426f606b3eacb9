"""What of the notebooks' outputs is compared: no record, which has every digit; measurements where a user has them."""

import os

import pytest

from profilecal_pages.notebooks import MIME

REAL_DATA = "PROFILECAL_REAL_DATA"


def pytest_collection_modifyitems(items):
    for item in items:
        if MIME not in getattr(item.parent, "skip_compare", [MIME]):
            item.parent.skip_compare += (MIME,)
    if not os.environ.get(REAL_DATA):
        for item in items:
            if item.path.name == "61_real_scanner.ipynb":
                item.add_marker(pytest.mark.skip(reason=f"{REAL_DATA} is not set: see data/README.md"))
