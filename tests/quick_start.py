"""A plugin that `make test` loads before nbval's: notebooks' kernels start at once.

A process that has imported what notebooks import forks for each. Kernels talk by
sockets in files: of two that start at once, both may choose the same port. jsonschema
does without a grammar of web addresses, which nothing here needs and each process would
take over a second to compile.
"""

import itertools
import multiprocessing
import os
import sys
import tempfile
import time

sys.modules["rfc3987_syntax"] = None
# after the notebooks, so that no core waits for one of them in the end
LONG = [
    *("test_notebooks.py", "test_sweep.py", "test_import_scan.py", "test_command.py"),
    *("test_page.py", "test_stopped.py", "test_delay.py", "test_fuzz.py"),
    *("test_without_processes.py", "test_documented.py"),
]
IMPORTED = [
    "matplotlib.pyplot",
    "scipy.stats",
    "ipykernel.kernelapp",
    "profilecal_tool.report.page",
    "profilecal_tool.sweep",
    "profilecal_tool.plan.task",
    "profilecal_tool.importing.import_scan",
    "profilecal_papers.batches",
    "profilecal_papers.ball_study",
    "profilecal_papers.edge_tables",
    "profilecal_papers.comparison",
]


def can_wait(path):
    return path.suffix == ".py" and path.name not in LONG


def pytest_collection_modifyitems(items):
    items.sort(key=lambda item: can_wait(item.path))


def serve(arguments, cwd, environment):
    """Be a kernel, whose figures and tables are a notebook's."""
    import matplotlib
    import pandas as pd
    from ipykernel.kernelapp import IPKernelApp

    os.setsid()
    os.chdir(cwd)
    os.environ.update(environment)
    matplotlib.rcParams["backend"] = "module://matplotlib_inline.backend_inline"
    pd.set_option("display.max_columns", 20)
    IPKernelApp.launch_instance(arguments)


class Kernel:
    """A forked process with the methods of `subprocess.Popen`."""

    stdin = stdout = stderr = None

    def __init__(self, command, env, cwd=None, **_):
        place = cwd or os.getcwd()
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(IMPORTED)
        self.process = context.Process(target=serve, args=(command[3:], place, env))
        self.process.start()
        self.pid = self.process.pid
        while os.getpgid(self.pid) != self.pid:  # whose group will be killed
            time.sleep(0.01)

    def poll(self):
        return self.process.exitcode

    def wait(self):
        self.process.join()
        return self.poll()


def pytest_sessionstart():
    from jupyter_client import KernelManager
    from jupyter_client.provisioning import local_provisioner
    from nbval import kernel

    sockets = tempfile.TemporaryDirectory()
    count = itertools.count()

    def manager(**options):
        socket = f"{sockets.name}/{next(count)}"
        return KernelManager(transport="ipc", ip=socket, **options)

    if os.name == "posix":
        kernel.KernelManager = manager
        local_provisioner.launch_kernel = Kernel
