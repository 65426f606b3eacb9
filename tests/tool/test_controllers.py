"""What is pasted into a controller is the pose."""

import re

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from profilecal.scan.conventions import CONVENTIONS
from profilecal_tool.controllers import CONTROLLERS, for_controller, writing_like

POSE = np.eye(4)
POSE[:3, :3] = Rotation.from_euler("xyz", [170, -20, 30], degrees=True).as_matrix()
POSE[:3, 3] = 6.0252, 54.18211, 364.25534
NUMBER = re.compile(r"(?<![\w.])-?\d+\.?\d*(?:e-?\d+)?")
EULER = {"kuka": "ZYX", "fanuc": "xyz", "kawasaki": "ZYZ", "staubli": "XYZ"}


def rotation_of(vendor, numbers):
    """The rotation that the numbers behind a position are."""
    if vendor in EULER:
        return Rotation.from_euler(EULER[vendor], numbers[:3], degrees=True)
    if vendor == "ur":
        return Rotation.from_rotvec(numbers[:3])
    return Rotation.from_quat(numbers[:4], scalar_first=vendor == "abb")


@pytest.mark.parametrize("vendor", CONTROLLERS)
def test_what_is_pasted_into_a_controller_is_the_pose(vendor):
    numbers = np.array(NUMBER.findall(for_controller(vendor, POSE)), dtype=float)
    if vendor == "matrix":
        assert_allclose(numbers.reshape(4, 4), POSE, atol=1e-8)
        return
    unit_mm = 1000 if vendor in ("ur", "ros") else 1
    assert_allclose(unit_mm * numbers[:3], POSE[:3, 3], atol=0.0005001)
    turned = rotation_of(vendor, numbers[3:]).inv() * Rotation.from_matrix(POSE[:3, :3])
    assert np.degrees(turned.magnitude()) < 2e-4


def test_there_is_a_controller_for_each_convention():
    for convention in CONVENTIONS:
        name, _ = CONTROLLERS[writing_like(convention.name)]
        assert name == convention.name
