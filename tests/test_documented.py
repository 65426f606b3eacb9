"""The examples in docstrings and in docs run."""

import doctest
from importlib import import_module
from pathlib import Path

ROOT = Path(__file__).parents[1]
LIB = ROOT / "lib"
MODULES = sorted(LIB.rglob("[a-z]*.py"))


def test_examples_run():
    examples = 0
    for path in MODULES:
        place = path.relative_to(LIB).with_suffix("")
        module = import_module(".".join(place.parts))
        # of the library as they are copied
        is_library = place.parts[0] == "profilecal"
        ran = doctest.testmod(module, globs={} if is_library else None)
        assert not ran.failed, place
        examples += ran.attempted
    assert examples >= 15


def test_the_page_on_python_runs():
    page = doctest.testfile(str(ROOT / "docs/python.md"), module_relative=False)
    assert page.attempted > 20
    assert not page.failed
