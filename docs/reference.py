"""The reference as pages for Sphinx's autodoc: the public names, each on a page of its
own, and all rooms of the packages.
"""

import ast
import json
import pkgutil
import re
from dataclasses import fields
from importlib import import_module
from pathlib import Path
from types import ModuleType

import profilecal
from profilecal.targets.target import Target

ROOT = Path(__file__).parents[1]
CONTRIBUTING = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
ROOMS = re.findall(r"^\| `(profilecal\.\w+)` \|", CONTRIBUTING, re.M)  # in their order
BESIDE = ("profilecal_pages", "profilecal_papers", "profilecal_tool")


def write_reference(folder: Path, notebooks: list[Path]) -> None:
    """Write the pages: profilecal, one a public name, rooms, one a room or package."""
    (folder / "rooms").mkdir(parents=True)
    pages = {"profilecal": public_page(), "rooms": rooms_page()}
    pages |= {name: name_page(name) for name in profilecal.__all__}
    used = uses(notebooks)
    pages |= {f"rooms/{room}": room_page(room, used) for room in ROOMS}
    pages |= {f"rooms/{package}": package_page(package) for package in BESIDE}
    for name, text in pages.items():
        (folder / f"{name}.rst").write_text(text, encoding="utf-8")


def public_page() -> str:
    """All public names in a table a group."""
    parts = [title("profilecal"), ".. automodule:: profilecal\n"]
    for group, names in public_groups().items():
        parts += [title(group.capitalize(), "-"), table(names)]
    parts.append(contents(profilecal.__all__))
    return "\n".join(parts)


def public_groups() -> dict[str, list[str]]:
    """The public names under the comments that the dictionary PUBLIC has of them."""
    source = Path(profilecal.__file__).read_text(encoding="utf-8")
    entries = source.split("PUBLIC = {")[1].split("\n}")[0]
    groups = {}
    for part in re.split(r"^ +# ", entries, flags=re.M)[1:]:
        group, lines = part.split("\n", 1)
        modules = ast.literal_eval("{" + lines + "}")
        groups[group] = [name for names in modules.values() for name in names]
    return {group: names for group, names in groups.items() if names}


def name_page(name: str) -> str:
    """A public name; of a target its fields alone, as its room has the contract."""
    thing = getattr(profilecal, name)
    lines = [title(name), ".. currentmodule:: profilecal\n"]
    if not isinstance(thing, type):
        return "\n".join([*lines, f".. autofunction:: {name}"])
    options = ["members:", "inherited-members:"]
    if issubclass(thing, Target):
        options = [f"members: {', '.join(field.name for field in fields(thing))}"]
    if issubclass(thing, Exception):
        options = []
    if thing.__base__ is not object:
        options.append("show-inheritance:")
    kind = "exception" if issubclass(thing, Exception) else "class"
    lines += [f".. auto{kind}:: {name}", "   :undoc-members:"]
    return "\n".join([*lines, *(f"   :{option}" for option in options)])


def rooms_page() -> str:
    """All rooms of the library and the packages beside it."""
    text = "Each room of the library imports from those above it."
    listed = [title("Room by room"), text, "", table(ROOMS)]
    beside = [title("Beside the library", "-"), table(BESIDE)]
    pages = [f"rooms/{name}" for name in (*ROOMS, *BESIDE)]
    return "\n".join([*listed, *beside, contents(pages)])


def room_page(room: str, used: dict[str, list[str]]) -> str:
    """What a room is for, and all its classes and functions by module. Those that have
    a page of their own are links to it.
    """
    parts = [title(room), f".. automodule:: {room}\n"]
    for module in modules_of(room):
        name = module.__name__
        own = profilecal.PUBLIC.get(name.removeprefix("profilecal."), [])
        others = [public for public in names_of(module) if public not in own]
        parts += [title(name.removeprefix(f"{room}."), "-"), f".. automodule:: {name}"]
        if others:
            parts.append(f"   :members: {', '.join(others)}")
        parts.append("   :undoc-members:\n")
        if own:
            links = ", ".join(f":py:obj:`profilecal.{public}`" for public in own)
            parts.append(f"On pages of their own: {links}.\n")
        if name in used:
            pages = ", ".join(
                f":doc:`{stem[:2]} </notebooks/{stem}>`" for stem in used[name]
            )
            parts.append(f"Used in notebooks {pages}.\n")
    return "\n".join(parts)


def package_page(package: str) -> str:
    """What the modules of a package are for, with the first lines of their names."""
    parts = [title(package), f".. automodule:: {package}\n"]
    for module in modules_of(package):
        name = module.__name__
        parts += [title(name.removeprefix(f"{package}."), "-")]
        parts.append(f".. automodule:: {name}\n")
        if names_of(module):
            parts.append(table(names_of(module)))
    return "\n".join(parts)


def modules_of(package: str) -> list[ModuleType]:
    """The modules under a package, in the order of their names."""
    path = import_module(package).__path__
    found = pkgutil.walk_packages(path, f"{package}.")
    names = [entry.name for entry in found if not entry.name.endswith("__main__")]
    return [import_module(name) for name in names]


def names_of(module: ModuleType) -> list[str]:
    """The public classes and functions that a module defines."""
    return [
        name
        for name, value in vars(module).items()
        if not name.startswith("_")
        and callable(value)
        and getattr(value, "__module__", "") == module.__name__
    ]


def uses(notebooks: list[Path]) -> dict[str, list[str]]:
    """Which notebooks import from each module."""
    found = {}
    for path in notebooks:
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        sources = ["".join(c["source"]) for c in cells if c["cell_type"] == "code"]
        imports = re.findall(r"^from (profilecal\.[\w.]+)", "\n".join(sources), re.M)
        for name in dict.fromkeys(imports):
            found.setdefault(name, []).append(path.stem)
    return found


def title(text: str, under: str = "=") -> str:
    return f"{text}\n{under * len(text)}\n"


def table(names) -> str:
    """Names with the first sentences of their docstrings, as links."""
    lines = [".. autosummary::", "   :nosignatures:", ""]
    return "\n".join([*lines, *(f"   {name}" for name in names), ""])


def contents(pages) -> str:
    """A table of contents that only the sidebar shows."""
    lines = [".. toctree::", "   :hidden:", ""]
    return "\n".join([*lines, *(f"   {name}" for name in pages), ""])
