"""What a browser's Python needs, for `make lite`: pages that install the package first,
and the example scans, where the pages look for them.

python docs/lite.py results/lite/files
"""

import json
import shutil
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
FIRST = {
    "cell_type": "code",
    "execution_count": None,
    "id": "install",
    "metadata": {},
    "outputs": [],
    "source": "%pip install -q profilecal[tool] sympy",
}
KERNEL = {"name": "python", "display_name": "Python (Pyodide)", "language": "python"}


def write_pages(folder: Path) -> None:
    """The pages and their data, in a new folder."""
    shutil.copytree(ROOT / "data" / "examples", folder / "data" / "examples")
    (folder / "notebooks").mkdir()
    for path in (ROOT / "notebooks").glob("[0-9]*"):
        page = path.read_text(encoding="utf-8")
        if path.suffix == ".ipynb":
            notebook = json.loads(page)
            notebook["cells"].insert(0, FIRST)
            notebook["metadata"]["kernelspec"] = KERNEL
            page = json.dumps(notebook)
        (folder / "notebooks" / path.name).write_text(page, encoding="utf-8")


if __name__ == "__main__":
    write_pages(Path(sys.argv[1]))
