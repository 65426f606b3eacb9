"""The edge in raw profiles: where there is none, and which of several it is."""

import numpy as np
import pytest
from finding import features_of, normalised, shapes_found, share_found
from numpy.random import default_rng
from raw_profiles import balls, scan, scan_planes, turned

import profilecal as pc
from profilecal.profiles.candidates import Candidate
from profilecal.profiles.edges import of_usual_angle
from profilecal.profiles.features import nothing
from profilecal.simulation.robot import Scanner


@pytest.mark.parametrize(
    "z",
    [
        lambda x: 80 + 0 * x,
        lambda x: 80 + 0.5 * x,
        lambda x: np.where(x > 19.8, 80.0, 100.0),
    ],
    ids=["level", "slanted", "cut off"],
)
def test_a_perfect_plane_has_no_edge_nor_has_a_step_where_the_profile_ends(z):
    x = np.linspace(-20, 20, 980)
    (feature,) = features_of("edge", [np.stack([x, z(x)], axis=-1)])
    assert feature.reason


def test_where_both_ends_of_a_face_show_the_corner_tells_which_is_the_edge():
    """A narrow bar in front of nothing, its side face seen from few poses."""
    plan = {"groups": 10, "positions": 4, "scanner": vars(Scanner(points=300))}
    scan, truth = pc.simulate("edge", seed=502, measured="profiles", **plan)
    features = features_of("edge", scan.values)
    assert shapes_found(features) == {"corner"}
    assert 0.2 < share_found(features) < 0.5

    assert normalised(features, scan_planes(scan, truth)[1])[0] < 2


def test_heights_above_zero_pass_for_depths_which_a_bar_shows():
    """Its corner points away then."""
    plan = {"groups": 10, "scanner": {"points": 300}, "specimen": "parallel bar"}
    scan, _ = pc.simulate("edge", measured="profiles", **plan)
    heights = [rows * [1, -1] + [0, 400] for rows in scan.values]
    features = features_of("edge", heights)
    assert share_found(features) == 0
    assert "where z are heights that are all above zero" in features[0].reason


def test_where_most_profiles_have_several_corners_others_show_none():
    """A ball passes for a polygon, of which now and then one corner stands out."""
    features = features_of("edge", balls(default_rng(1), 40)[0])
    assert share_found(features) == 0
    others = "most profiles have several candidates for the corner"
    assert 0 < [one.reason for one in features].count(others) < 20


SLOPE = np.tan(np.radians(12.5))
ROOF = [[-20, 20 * SLOPE], [0, 0], [20, 20 * SLOPE]]
CHAMFER = [*ROOF[:2], [12, 12 * SLOPE], [14, 12 * SLOPE + 8]]


@pytest.mark.parametrize("chain", [ROOF, CHAMFER], ids=["roof", "chamfer"])
def test_a_shallow_corner_is_as_exact_as_stated(chain):
    """At 25° a face is within the tolerance of the next one for half a millimetre: at
    both ends of a chamfer.
    """
    rng = default_rng(2)
    places = rng.uniform([-5, 190], [5, 230], (120, 2))
    chains = [turned(chain, rng.uniform(-0.2, 0.2), place) for place in places]
    features = features_of("edge", scan(chains, rng))
    assert share_found(features) > 0.9
    ratio, count = normalised(features, places[:, None])
    assert abs(ratio - 1) < 4 / np.sqrt(count)


def corner(rng, count):
    """A profile (30 + count, 2) of a corner that shows `count` points of one side."""
    left = np.stack([-0.5 * np.arange(30, 0, -1), np.zeros(30)], axis=-1)
    right = np.linspace([0.1, 0.6], [3.0, 18], count)
    profile = np.concatenate([left, right]) + np.array([0, 100])
    return profile + rng.normal(0, 0.02, profile.shape)


def test_a_corner_with_a_side_of_few_points_says_so():
    """Six, or three, among profiles that show it well."""
    rng = default_rng(9)
    profiles = [corner(rng, count) for count in (40,) * 8 + (6, 3)]
    *good, six, three = features_of("edge", profiles)
    assert share_found(good) == 1
    assert not six.found
    assert not three.found
    start = "one side of the corner shows"
    assert six.reason == f"{start} fewer than 10 points beyond the rounded tip"
    assert three.reason == f"{start} too few points for a line"


def test_of_corners_that_of_nearly_the_usual_angle_counts_before_a_longer_one():
    """By 30° another one counts if it is alone, by 40° none does."""
    profiles = [[90], [91], [89], [90], [116, 95], [116], [130]]
    corners = [
        [Candidate(nothing(""), angle=np.radians(a)) for a in own] for own in profiles
    ]
    chosen, reasons = of_usual_angle(corners, [""] * 7)
    left = [[round(np.degrees(one.angle)) for one in own] for own in chosen]
    assert left == [[90], [91], [89], [90], [95], [116], []]
    assert reasons == [""] * 6 + ["a corner of 130°, 91° in other profiles"]
