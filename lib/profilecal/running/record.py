"""What a notebook hands out to a sweep, by way of its own output, and when it asserts what it found.

Notebooks import this, so it costs them nothing.
"""

import ast
import json
from pathlib import Path

MIME = "application/vnd.profilecal.record"


def record(table=None, /, **values) -> None:
    """Hand out values, or a pandas table, of the notebook that calls this: they become columns of the sweep's table.

    A run with a table gets one row for each of the table's. Raises TypeError for a value that no table can hold.
    """
    from IPython.display import display

    rows = [values | row for row in ([] if table is None else table.to_dict("records"))] or [values]
    display({"text/plain": f"recorded: {', '.join(rows[0])}", MIME: json.dumps(rows, default=_plain)}, raw=True)


def at_defaults() -> bool:
    """Whether a notebook's parameters are those that its findings are asserted for: those of the cell tagged
    `parameters` in its file, which stands in the working folder and is called as its `results` say. No file, no
    findings."""
    from IPython import get_ipython

    names = get_ipython().user_ns
    file = Path(f"{names['results'].notebook}.ipynb")
    if not file.exists():
        return False
    cells = json.loads(file.read_text(encoding="utf-8"))["cells"]
    (source,) = (cell["source"] for cell in cells if "parameters" in cell["metadata"].get("tags", []))
    entries = [entry for entry in ast.parse("".join(source)).body if isinstance(entry, ast.AnnAssign)]
    defaults = {entry.target.id: ast.literal_eval(entry.value) for entry in entries if entry.target.id != "results_dir"}
    return all(names[name] == value for name, value in defaults.items())


def _plain(value):
    """NumPy's numbers as Python's."""
    if hasattr(value, "dtype") and value.ndim == 0:
        return value.item()
    raise TypeError(f"recorded value {value!r} is a {type(value).__name__}; expected a number, text, true or false")


def recorded(notebook: dict) -> list[dict]:
    """The rows that an executed notebook recorded; one without columns where it recorded nothing."""
    outputs = [output.get("data", {}) for cell in notebook["cells"] for output in cell.get("outputs", [])]
    return [row for data in outputs for row in json.loads("".join(data.get(MIME, "[]")))] or [{}]
