"""Orientations as robots print them: in and out, and what cannot be one."""

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from profilecal.scan.conventions import (
    CONVENTIONS,
    find_convention,
    from_rotations,
    named,
    to_rotations,
)


def rodrigues(*vector):
    """The rotation about a vector by its length."""
    angle = np.linalg.norm(vector)
    x, y, z = np.array(vector) / angle
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def turn(axis, degrees):
    return rodrigues(*np.radians(degrees) * np.eye(3)["xyz".index(axis)])


def from_quaternion(w, *vector):
    sine = np.linalg.norm(vector)
    return rodrigues(*2 * np.arctan2(sine, w) / sine * np.array(vector))


FORMULA = {
    "quaternion": from_quaternion,
    "rotation vector": rodrigues,
    "KUKA angles": lambda a, b, c: turn("z", a) @ turn("y", b) @ turn("x", c),
    "FANUC angles": lambda w, p, r: turn("z", r) @ turn("y", p) @ turn("x", w),
    "Stäubli angles": lambda a, b, c: turn("x", a) @ turn("y", b) @ turn("z", c),
    "Kawasaki angles": lambda o, a, t: turn("z", o) @ turn("y", a) @ turn("z", t),
    "matrix": lambda *entries: np.array(entries).reshape(3, 3),
}


@pytest.mark.parametrize("convention", CONVENTIONS, ids=lambda c: c.name)
def test_every_convention_goes_in_and_out_and_means_its_formula(convention):
    rotations = Rotation.random(1000, rng=default_rng(1)).as_matrix()
    block = from_rotations(convention, rotations)
    assert block.shape == (1000, len(convention.columns))
    written_out = np.array([FORMULA[convention.name](*row) for row in block])
    assert_allclose(written_out, rotations, atol=1e-9)
    assert_allclose(to_rotations(convention, block), rotations, atol=1e-9)


@pytest.mark.parametrize(
    ("columns", "sentence"),
    [
        (["rx", "ry", "rz", *"wpr"], "c; w, p, r; .* rotation vector and FANUC angles"),
        (["pose", "qx"], "block of orientation columns, .* none among pose, qx"),
    ],
)
def test_columns_of_no_or_two_conventions_are_refused(columns, sentence):
    with pytest.raises(ValueError, match=sentence):
        find_convention(columns)


def test_names_decide_not_their_order():
    quaternion = find_convention(["qx", "pose", "qw", "qz", "qy"])
    assert quaternion.columns == ("qw", "qx", "qy", "qz")


IMPOSSIBLE = {  # by what is said of them
    "quaternion of length 1.414; expected length 1": ("quaternion", [1, 1, 0, 0]),
    "rotation vector of length 180; expected radians": (
        "rotation vector",
        [180, 0, 0],
    ),
    r"angle of 1e\+308; expected degrees, at most 720": (
        "FANUC angles",
        [0, 0, 1e308],
    ),
    "matrix with R Rᵀ off the identity by 3": ("matrix", np.diag([1, 1, 2])),
    "matrix with determinant -1, a reflection": ("matrix", np.diag([1, 1, -1])),
}


@pytest.mark.parametrize("sentence", IMPOSSIBLE)
def test_impossible_orientations_are_refused_with_their_row(sentence):
    name, orientation = IMPOSSIBLE[sentence]
    good = from_rotations(named(name), np.eye(3)[None])[0]
    with pytest.raises(ValueError, match=f"row 1: {sentence}"):
        to_rotations(named(name), [good, np.ravel(orientation)])
