"""A plugin that `make test` loads before nbval's.

jsonschema does without a grammar of web addresses, which nothing here needs and each
process would take over a second to compile. Kernels talk by sockets in files: of two
that start at once, both may choose the same port.
"""

import itertools
import os
import sys
import tempfile

sys.modules["rfc3987_syntax"] = None
# after the notebooks, so that no core waits for one of them in the end
LONG = ("test_notebooks.py", "test_sweep.py", "test_import_scan.py", "test_command.py")
LONG += ("test_page.py", "test_stopped.py")


def can_wait(path):
    return path.suffix == ".py" and path.name not in LONG


def pytest_collection_modifyitems(items):
    items.sort(key=lambda item: can_wait(item.path))


def pytest_sessionstart():
    from jupyter_client import KernelManager
    from nbval import kernel

    sockets = tempfile.TemporaryDirectory()
    count = itertools.count()

    def manager(**options):
        socket = f"{sockets.name}/{next(count)}"
        return KernelManager(transport="ipc", ip=socket, **options)

    if os.name == "posix":
        kernel.KernelManager = manager
