"""The library's reference, room by room, from its source: names, signatures,
docstrings.
"""

import ast
import json
import re
from pathlib import Path


def pages_of_rooms(package: Path, notebooks: list[Path]) -> dict[str, str]:
    """A Markdown page for each room that names something public."""
    used = uses(notebooks)
    places = {
        module_name(path, package): path for path in sorted(package.rglob("*.py"))
    }
    pages = {}
    for room in sorted({path.parent for path in package.glob("*/__init__.py")}):
        if not (room / "__init__.py").read_text(encoding="utf-8").strip():
            continue
        about = (
            ast.get_docstring(
                ast.parse((room / "__init__.py").read_text(encoding="utf-8"))
            )
            or ""
        )
        parts = [f"# {room.name}\n\n{linked(about, places)}\n"]
        for path in sorted(room.glob("[a-z]*.py")):
            parts.append(module(path, module_name(path, package), used, places))
        pages[room.name] = "\n".join(parts)
    return pages


def module_name(path: Path, package: Path) -> str:
    """Such as joint.solve."""
    return ".".join(path.relative_to(package).with_suffix("").parts)


def uses(notebooks: list[Path]) -> dict[str, list[str]]:
    """Which notebooks import from each module."""
    found = {}
    for path in notebooks:
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        code = "\n".join(
            "".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"
        )
        for name in dict.fromkeys(
            re.findall(r"^from profilecal\.([\w.]+) import", code, re.M)
        ):
            found.setdefault(name, []).append(path.stem)
    return found


def module(path: Path, name: str, used, places) -> str:
    """One module: what it is for, and its public classes and functions."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    parts = [f"## {name}\n", linked(ast.get_docstring(tree) or "", places), ""]
    if name in used:
        pages = ", ".join(
            f"[{stem[:2]}](../notebooks/{stem}.ipynb)" for stem in used[name]
        )
        parts.append(f"*Used in notebooks {pages}.*\n")
    for node in tree.body:
        if isinstance(
            node, ast.FunctionDef | ast.ClassDef
        ) and not node.name.startswith("_"):
            parts += entry(node, places)
            if isinstance(node, ast.ClassDef):
                for method in node.body:
                    if (
                        isinstance(method, ast.FunctionDef)
                        and method.name[0] != "_"
                        and ast.get_docstring(method)
                    ):
                        parts += entry(method, places, f"{node.name}.")
    return "\n".join(parts)


def entry(node, places, owner: str = "") -> list[str]:
    """One class or function."""
    text = [f"### `{owner}{node.name}`\n", "```python", signature(node), "```", ""]
    return [*text, linked(ast.get_docstring(node) or "", places), ""]


def signature(node) -> str:
    """As in the source; of a class its fields, with what is said of each."""
    if isinstance(node, ast.ClassDef):
        fields = [
            f"    {ast.unparse(entry)}"
            for entry in node.body
            if isinstance(entry, ast.AnnAssign)
        ]
        return "\n".join([f"class {node.name}", *fields])
    returns = f" -> {ast.unparse(node.returns)}" if node.returns else ""
    return f"{node.name}({ast.unparse(node.args)}){returns}"


def linked(text: str, places) -> str:
    """A docstring in which `room.module` is a link."""

    def link(match):
        name = match[1]
        if name not in places or "." not in name:
            return match[0]
        return f"[`{name}`]({name.split('.')[0]}.md#{name.replace('.', '')})"

    return re.sub(r"`([\w.]+)`", link, text.replace("<", "\\<"))
