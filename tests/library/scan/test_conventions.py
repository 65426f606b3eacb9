"""Orientations as robots print them: in and out, and what cannot be one."""

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from profilecal.scan.conventions import (
    CONVENTIONS,
    from_rotations,
    named,
    to_rotations,
)


def about(*vector):
    """The rotation about a vector by its length."""
    return expm(np.cross(np.eye(3), vector))


def turn(axis, degrees):
    return about(*np.radians(degrees) * np.eye(3)["xyz".index(axis)])


def from_quaternion(w, *vector):
    sine = np.linalg.norm(vector)
    return about(*2 * np.arctan2(sine, w) / sine * np.array(vector))


FORMULA = {
    "quaternion": from_quaternion,
    "rotation vector": about,
    "KUKA angles": lambda a, b, c: turn("z", a) @ turn("y", b) @ turn("x", c),
    "FANUC angles": lambda w, p, r: turn("z", r) @ turn("y", p) @ turn("x", w),
    "Stäubli angles": lambda a, b, c: turn("x", a) @ turn("y", b) @ turn("z", c),
    "Kawasaki angles": lambda o, a, t: turn("z", o) @ turn("y", a) @ turn("z", t),
    "matrix": lambda *entries: np.array(entries).reshape(3, 3),
}


@pytest.mark.parametrize("convention", CONVENTIONS, ids=lambda c: c.name)
def test_every_convention_goes_in_and_out_and_means_its_formula(convention):
    rotations = Rotation.random(100, rng=default_rng(1)).as_matrix()
    block = from_rotations(convention, rotations)
    assert block.shape == (100, len(convention.columns))
    written_out = np.array([FORMULA[convention.name](*row) for row in block])
    assert_allclose(written_out, rotations, atol=1e-9)
    assert_allclose(to_rotations(convention, block), rotations, atol=1e-9)


IMPOSSIBLE = {  # by what is said of them
    "rotation vector of length 180; expected radians": (
        "rotation vector",
        [180, 0, 0],
    ),
    r"angle of 1e\+308; expected degrees, at most 720": (
        "FANUC angles",
        [0, 0, 1e308],
    ),
    "matrix with R Rᵀ off the identity by 3": ("matrix", np.diag([1, 1, 2])),
    "matrix .* and determinant -1; expected a": ("matrix", np.diag([1, 1, -1])),
}


@pytest.mark.parametrize("sentence", IMPOSSIBLE)
def test_impossible_orientations_are_refused_with_their_row(sentence):
    name, orientation = IMPOSSIBLE[sentence]
    good = from_rotations(named(name), np.eye(3)[None])[0]
    with pytest.raises(ValueError, match=f"row 1: {sentence}"):
        to_rotations(named(name), [good, np.ravel(orientation)])
