"""The pages where there are no processes and threads, as in a browser's Python."""

import shutil
import subprocess
import sys
from pathlib import Path

PAGES = "00_start_here.ipynb", "02_eight_points.ipynb"
ROOT = Path(__file__).parents[2]
ALONE = """
import json, sys
from importlib import import_module
import IPython.core.interactiveshell, matplotlib_inline.backend_inline
import matplotlib.pyplot, pandas, scipy.spatial, scipy.stats, tqdm

sys.modules |= dict.fromkeys(["multiprocessing", "subprocess", "fcntl"])
sys.modules["multiprocessing.resource_tracker"] = None
import profilecal, profilecal_pages.figures, profilecal_pages.notebooks

for name in ("edge_study", "edge_tables", "disk_study", "ball_study", "comparison"):
    import_module(f"profilecal_papers.{name}")

shell = IPython.core.interactiveshell.InteractiveShell.instance()
shell.enable_gui = lambda gui=None: None
for path in sys.argv[1:]:
    for cell in json.loads(open(path, encoding="utf-8").read())["cells"]:
        if cell["cell_type"] == "code":
            shell.run_cell("".join(cell["source"]), silent=True).raise_error()
"""


def test_pages_run_where_there_are_no_processes(tmp_path):
    folder = tmp_path / "notebooks"
    folder.mkdir()
    (tmp_path / "data").symlink_to(ROOT / "data")
    pages = [shutil.copy(ROOT / "notebooks" / page, folder) for page in PAGES]
    command = [sys.executable, "-c", ALONE, *pages]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
