"""Changes of a folder of files, of which some are mistakes; whether what was read is
what was written.
"""

import pandas as pd
from numpy.testing import assert_allclose, assert_array_equal

ABOUT = ("kind", "labels", "measured", "sizes", "noise", "title", "mount", "convention")
ABOUT += ("sweeps", "delay_ms", "group_given")


def assert_same(first, second):
    """Two scans, but for rounding."""
    assert_allclose(first.T_base_flange, second.T_base_flange, atol=1e-8)
    assert_array_equal(first.times, second.times)
    for one, other in zip(first.values, second.values, strict=True):
        assert_allclose(one, other, atol=1e-8)
    for name in ABOUT:
        assert getattr(first, name) == getattr(second, name)
    assert_array_equal(first.group, second.group)
    assert_array_equal(first.side, second.side)


def edited(name, old, new, count=1):
    """In the text of a file, from something that is there."""

    def change(folder):
        content = (folder / name).read_text()
        assert old in content
        (folder / name).write_text(content.replace(old, new, count))

    return change


def tabulated(name, function):
    """In the rows and columns of a file."""

    def change(folder):
        table = pd.read_csv(folder / name)
        function(table).to_csv(folder / name, index=False)

    return change


def written(name, text):
    return lambda folder: (folder / name).write_text(text)


def removed(name):
    return lambda folder: (folder / name).unlink()


def instead_of(name, make):
    """Something else where a file was."""

    def change(folder):
        (folder / name).unlink()
        make(folder / name)

    return change
