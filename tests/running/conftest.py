"""What the tests of running notebooks share."""

import pytest

from profilecal.running import notebooks


@pytest.fixture(autouse=True, scope="module")
def kept_processes():
    """The processes that execute notebooks stay for the next run, which then need not import papermill again."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(notebooks, "stop_idle", lambda: None)
        yield
    notebooks.stop_idle()
    assert not notebooks._idle
