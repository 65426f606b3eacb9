"""The face of a plane in raw profiles: how often it is found, and how well."""

import numpy as np
import pytest
from finding import assert_means_are_as_exact_as_stated, features_of
from raw_profiles import planes, spoil


def off_face(points, ends):
    along = (ends[1] - ends[0]) / np.hypot(*(ends[1] - ends[0]))
    return (points - ends[0]) @ [-along[1], along[0]]


@pytest.mark.parametrize("spoiled", [False, True], ids=["clean", "spoiled"])
def test_a_face_is_found_and_as_exact_as_stated(spoiled):
    rng = np.random.default_rng(3)
    profiles, faces = planes(rng)
    if spoiled:
        profiles = spoil(profiles, faces[:, 1:], rng)
    features = features_of("plane", profiles)
    assert_means_are_as_exact_as_stated(features, faces, off_face)
