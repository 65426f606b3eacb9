"""What is pasted into a controller is the pose."""

import re

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from profilecal_tool.controllers import CONTROLLERS, for_controller

POSE = np.eye(4)
POSE[:3, :3] = Rotation.from_euler("xyz", [170, -20, 30], degrees=True).as_matrix()
POSE[:3, 3] = 6.0252, 54.18211, 364.25534
NUMBER = re.compile(r"-?\d+\.?\d*(?:e-?\d+)?")
ROTATION = {  # from the numbers behind the position
    "abb": lambda n: Rotation.from_quat(n[:4], scalar_first=True),
    "ros": lambda n: Rotation.from_quat(n[:4]),
    "ur": lambda n: Rotation.from_rotvec(n[:3]),
    "kuka": lambda n: Rotation.from_euler("ZYX", n[:3], degrees=True),
    "fanuc": lambda n: Rotation.from_euler("xyz", n[:3], degrees=True),
    "kawasaki": lambda n: Rotation.from_euler("ZYZ", n[:3], degrees=True),
    "staubli": lambda n: Rotation.from_euler("XYZ", n[:3], degrees=True),
}


def numbers_in(text):
    plain = text.replace("tf2_ros", "").replace("ros2", "")
    return np.array([float(number) for number in NUMBER.findall(plain)])


@pytest.mark.parametrize("vendor", ROTATION)
def test_what_is_pasted_into_a_controller_is_the_pose(vendor):
    numbers = numbers_in(for_controller(vendor, POSE))
    unit_mm = 1000 if vendor in ("ur", "ros") else 1
    assert_allclose(unit_mm * numbers[:3], POSE[:3, 3], atol=0.0005001)
    rotation = ROTATION[vendor](numbers[3:])
    turned = rotation.inv() * Rotation.from_matrix(POSE[:3, :3])
    assert np.degrees(turned.magnitude()) < 2e-4


def test_a_matrix_is_pasted_whole():
    numbers = numbers_in(for_controller("matrix", POSE))
    assert_allclose(numbers.reshape(4, 4), POSE, atol=1e-8)
    assert {"matrix", *ROTATION} == CONTROLLERS.keys()
