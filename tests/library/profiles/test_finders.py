"""What holds for every finder: how often and how well a target is found, what shows
nothing, and what must not matter.
"""

import os
from functools import partial

import numpy as np
import pytest
from finding import (
    features_of,
    normalised,
    shapes_found,
    share_found,
)
from many_scenes import IN_PROFILES
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal
from raw_profiles import (
    RADIUS,
    balls,
    disks,
    edges,
    planes,
    rods,
    scan_planes,
    spoil,
    tables,
)

import profilecal as pc

FUZZ = int(os.environ.get("PROFILECAL_FUZZ", "60"))
EVERYWHERE = np.full((250, 1, 2), np.inf)  # a target that no spoiling leaves alone


bars = partial(edges, "parallel bar")


def noise(rng):
    return rng.uniform([-50, 150], [50, 250], (50, 980, 2))


def tables_alone(rng):
    return tables(rng, 100)


POINTS = {
    "parallel bar": ("edge", bars, "corner"),
    "straight scale": ("edge", partial(edges, "straight scale"), "step end"),
    "disk": ("disk", disks, "chord"),
    "floating disk": ("disk", partial(disks, background=None), "chord"),
}


@pytest.mark.parametrize("name", POINTS)
def test_points_are_found_and_as_exact_as_stated(name):
    kind, make, shape = POINTS[name]
    rng = default_rng(1)
    profiles, truth = make(rng)
    features = features_of(kind, spoil(profiles, truth, rng))
    assert share_found(features) >= 0.99
    assert shapes_found(features) == {shape}
    ratio, count = normalised(features, truth)
    assert abs(ratio - 1) < 4 / np.sqrt(count)


# of less usual scanners: their entries, and the share of points that they miss
SCANNERS = {
    "large noise": ("edge", {"noise_mm": 0.3}, 0.0),
    "a wide spot": ("edge", {"resolution": 1.0}, 0.0),
    "a fifth missing": ("disk", {}, 0.2),
}


@pytest.mark.parametrize("name", SCANNERS)
def test_points_are_as_exact_as_stated_whatever_the_scanner(name):
    kind, scanner, missed = SCANNERS[name]
    plan = {"groups": 50, "positions": 4, "spread_deg": 20, "scanner": scanner}
    seen, truth = pc.simulate(kind, measured="profiles", **plan)
    rng = default_rng(1)
    profiles = [rows[rng.random(len(rows)) >= missed] for rows in seen.values]
    features = features_of(kind, profiles, 50)
    assert share_found(features) > 0.95
    ratio, count = normalised(features, scan_planes(seen, truth)[1])
    assert abs(ratio - 1) < 4 / np.sqrt(count)


CURVES = {
    "ball": ("ball", balls),
    "plane": ("plane", planes),
    "thin rod": ("rod", partial(rods, radius=5.0)),
    "floating thin rod": ("rod", partial(rods, radius=5.0, background=None)),
    "floating rod": ("rod", partial(rods, background=None)),
    "thick rod": ("rod", partial(rods, radius=60.0)),
}


@pytest.mark.parametrize("name", CURVES)
def test_curves_are_found(name):
    """How well: `targets/test_contract.py`."""
    kind, make = CURVES[name]
    rng = default_rng(3)
    profiles, truth = make(rng, 60)
    places = truth[:, 1:] if kind == "plane" else truth[:, None, :2]
    radius = getattr(make, "keywords", {}).get("radius", RADIUS)
    assert share_found(features_of(kind, spoil(profiles, places, rng), radius)) >= 0.99


@pytest.mark.parametrize(("step", "least"), [(0.5, 0.95), (1.0, 0.5), (2.0, 0)])
@pytest.mark.parametrize(
    ("kind", "make"), [("disk", disks), ("ball", balls), ("plane", planes)]
)
def test_a_target_is_found_where_depths_come_in_coarse_steps(kind, make, step, least):
    """Or nothing is, but for faces that are level by chance."""
    profiles = make(default_rng(3), 60)[0]
    profiles[..., 1] = np.rint(profiles[..., 1] / step) * step
    share = share_found(features_of(kind, profiles))
    assert least <= share <= max(2 * least, 0.1)


X = np.linspace(-40, 40, 801)
STAIRS = 130 + 0.5 * np.rint(X / 3)


@pytest.mark.parametrize(
    ("kind", "behind", "least_mm"),
    [("disk", 130.0, 0.01), ("disk", STAIRS, 0.1), ("plane", np.nan, 0.01)],
)
def test_rows_that_are_all_alike_are_not_known_exactly(kind, behind, least_mm):
    z = np.where(np.abs(X) < 22, 100.0, behind)
    (feature,) = features_of(kind, [np.stack([X, z], axis=-1)])
    assert feature.found
    assert (feature.covariance[:, 1, 1] > least_mm**2).all()


@pytest.mark.parametrize("kind", ["edge", "disk", "ball", "rod"])
@pytest.mark.parametrize("shown", [tables_alone, noise])
def test_a_table_or_noise_alone_shows_nothing(kind, shown):
    assert share_found(features_of(kind, shown(default_rng(4)))) == 0


def disks_aside(rng):
    """One tip is in view: where the view ends is not where the disk ends."""
    return disks(rng, 100, aside=60.0)[0]


OUTSIDE = {
    "edge": (bars, tables_alone),
    "disk": (disks, disks_aside),
    "ball": (balls, tables_alone),
    "rod": (rods, tables_alone),
}


@pytest.mark.parametrize("kind", OUTSIDE)
def test_a_target_outside_the_view_is_not_found_among_profiles_that_show_it(kind):
    inside, outside = OUTSIDE[kind]
    rng = default_rng(5)
    visible, truth = inside(rng)
    places = truth.reshape(len(truth), -1, truth.shape[-1])[..., :2]
    shown = spoil(visible[:100], places[:100], rng)
    hidden = spoil(outside(rng), EVERYWHERE[:100], rng)
    features = features_of(kind, [*shown, *hidden])
    assert share_found(features[:100]) >= 0.99
    assert share_found(features[100:]) == 0


# what another scanner may do to profiles, and what it does to the points in them
VIEWS = {
    "height for depth": (lambda p: p * [1, -1], lambda p: p * [1, -1]),
    "right for left": (lambda p: p * [-1, 1], lambda p: (p * [-1, 1])[:, ::-1]),
}


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize(("kind", "make"), [("edge", bars), ("disk", disks)])
def test_it_does_not_matter_how_the_scanner_counts(kind, make, view):
    """Signs change the arithmetic's rounding only, which may move a point over a
    threshold: 1e-9 mm.
    """
    change, change_points = VIEWS[view]
    profiles = make(default_rng(6))[0][:50]
    points = np.array([f.points for f in features_of(kind, profiles)])
    changed = np.array([f.points for f in features_of(kind, change(profiles))])
    assert_allclose(changed, change_points(points), atol=1e-9)


# what software may do to a profile's rows; no two of them have the same x
WRITTEN = {
    "missing points left out": lambda p, _: p[np.isfinite(p).all(axis=1)],
    "zeros for missing points": lambda p, _: np.nan_to_num(p),
    "last point first": lambda p, _: p[::-1],
    "shuffled": lambda p, rng: rng.permutation(p),
}
IN_FRONT_OF_NOTHING = {
    "edge": lambda rng: bars(rng, groups=2)[0],
    "disk": lambda rng: disks(rng, 20, background=None)[0],
    "ball": lambda rng: balls(rng, 20, background=500.0)[0],
    "plane": lambda rng: tables(rng, 20),
    "rod": lambda rng: rods(rng, 20, background=None)[0],
}


@pytest.mark.parametrize("way", WRITTEN)
@pytest.mark.parametrize("kind", IN_PROFILES)
def test_it_does_not_matter_how_a_file_is_written(kind, way):
    rng = default_rng(6)
    profiles = IN_FRONT_OF_NOTHING[kind](rng)
    profiles = profiles + rng.uniform(-0.05, 0.05, profiles.shape)
    written = [WRITTEN[way](profile, rng) for profile in profiles]
    found = features_of(kind, profiles), features_of(kind, written)
    assert share_found(found[0]) >= 0.95
    for profile, rows, *pair in zip(profiles, written, *found, strict=True):
        first, second = pair
        assert first.reason == second.reason
        assert_allclose(first.points, second.points, atol=1e-9)
        used = np.sort(profile[first.used], axis=0)
        assert_array_equal(np.sort(rows[second.used], axis=0), used)


def replaced(profile, i, j, rows):
    """A profile with other rows in place of those from i to j."""
    return np.concatenate([profile[:i], rows, profile[j:]])


def garbled(profile, i, j, rng):
    rows = rng.normal(size=(j - i, 2)) * 10.0 ** rng.integers(-3, 4)
    return replaced(profile, i, j, rows)


CORRUPTIONS = (
    lambda p, i, j, rng: replaced(p, i, j, np.full((j - i, 2), np.nan)),
    garbled,
    lambda p, i, j, rng: p * 10.0 ** rng.integers(-4, 5),
    lambda p, i, j, rng: rng.permutation(p),
    lambda p, i, j, rng: np.repeat(p, 2, axis=0)[:2000],
    lambda p, i, j, rng: p[:: rng.integers(1, 40)] * [1, -1],
)


NOTHING = [
    np.zeros((0, 2)),
    np.full((980, 2), np.nan),
    np.zeros((980, 2)),
    np.ones((1, 2)),
    np.ones((980, 2)),
]


@pytest.mark.parametrize("kind", IN_PROFILES)
def test_whatever_is_in_a_profile_gives_a_feature_or_a_reason(kind):
    """Warnings are errors here: no division by zero either."""
    rng = default_rng(10)
    shown = [make(rng, 10)[0] for make in (disks, balls, planes, rods)]
    shown.append(bars(rng, groups=1)[0])
    profiles = np.concatenate(shown)
    tried = [*NOTHING]
    for profile in profiles[rng.integers(len(profiles), size=FUZZ)]:
        for corrupt in rng.choice(CORRUPTIONS, size=rng.integers(1, 4)):
            i, j = np.sort(rng.integers(0, len(profile) + 1, 2))
            profile = corrupt(profile, i, j, rng)
        tried.append(profile)
    features = [features_of(kind, [profile])[0] for profile in tried]
    assert not any(feature.found for feature in features[: len(NOTHING)])
    for feature in features:
        assert feature.found != bool(feature.reason)
        if not feature.found:
            assert len(feature.points) == len(feature.used) == 0
        assert np.isfinite(feature.points).all()
        assert (np.linalg.eigvalsh(feature.covariance) >= 0).all()
