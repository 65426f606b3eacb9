"""The measurements of HandEyeSync, where a user has them (data/README.md)."""

import os
from pathlib import Path

import pytest

from profilecal.scan.imported import Layout, import_scan
from profilecal.scan.scan import Scan


def real_scan(name: str, entry: str = "") -> Scan:
    """ "edge", or "sphere"; `entry`: of its files, such as "feature_point". Skips the test where they are not."""
    folder = os.environ.get("PROFILECAL_REAL_DATA")
    if not folder:
        pytest.skip("the measurements of HandEyeSync are not here: PROFILECAL_REAL_DATA is not set")
    kind, sizes = ("edge", {}) if name == "edge" else ("ball", {"radius": 40.0})
    return import_scan(Path(folder) / "handeyesync" / name, kind, sizes, Layout(entry=entry))[0]
