"""What is found in raw profiles, how often, how well, and what is not."""

import numpy as np
import pytest
from raw_profiles import RADIUS, balls, disks, edges, planes, rods, spoil, tables
from scipy.differentiate import jacobian

from profilecal.calibration.observe import covariances
from profilecal.profiles.arcs import Section
from profilecal.simulation.robot import Scanner
from profilecal.simulation.spec import Spec, simulate_scan
from profilecal.targets import TARGETS
from profilecal.targets.edge import Edge
from profilecal.targets.target import find_features

BLANK = np.full((980, 2), np.nan)
ALONG = (4, 20, 35)  # of an arc's 40 points: near its steep ends and in its middle


def features_of(kind, profiles, radius=RADIUS):
    """What a target's finder makes of profiles (P, n, 2)."""
    return find_features(
        TARGETS[kind], profiles, (radius,) if TARGETS[kind].lengths and radius else ()
    )


def found(features):
    return np.array([feature.found for feature in features])


def normalised(features, truth):
    """Mean of eᵀ C⁻¹ e / 2 over all points found, 1 where the stated covariance is
    right; and their number.
    """
    error = np.concatenate(
        [f.points - t for f, t in zip(features, truth, strict=True) if f.found]
    )
    covariance = np.concatenate([f.covariance for f in features if f.found])
    return np.einsum(
        "na,nab,nb->n", error, np.linalg.inv(covariance), error
    ).mean() / 2, len(error)


SHOWN = {
    "bar": ("edge", "corner", lambda rng: edges("parallel bar", rng)),
    "scale": ("edge", "step end", lambda rng: edges("straight scale", rng)),
    "blade": ("edge", "tip", lambda rng: edges("knife blade", rng)),
    "disk": ("disk", "chord", disks),
    "floating disk": ("disk", "chord", lambda rng: disks(rng, background=None)),
}


@pytest.mark.parametrize("spoiled", [False, True], ids=["clean", "spoiled"])
@pytest.mark.parametrize("target", SHOWN)
def test_points_are_found_and_as_exact_as_stated(target, spoiled):
    """The mean of n squared errors, each over its variance, has a standard deviation of
    1 / √n.
    """
    kind, shape, make = SHOWN[target]
    rng = np.random.default_rng(1)
    profiles, truth = make(rng)
    features = features_of(
        kind, spoil(profiles, truth, rng) if spoiled else profiles, RADIUS
    )
    assert found(features).mean() >= 0.99
    assert {f.shape for f in features if f.found} == {shape}
    ratio, count = normalised(features, truth)
    assert ratio < 1 + 4 / np.sqrt(count)
    if shape != "tip":  # a tip's variance is an upper bound
        assert ratio > 1 - 4 / np.sqrt(count)


def test_both_tips_of_a_chord_together_are_as_exact_as_stated():
    """They lie on one fitted line, so that they err across it together: the mean of n
    squared errors in four dimensions has the standard deviation √(8 / n).
    """
    profiles, truth = disks(np.random.default_rng(2), 500)
    pairs = [
        (f, t)
        for f, t in zip(features_of("disk", profiles), truth, strict=True)
        if f.found
    ]
    error = np.array([(f.points - t).ravel() for f, t in pairs])
    covariance = covariances([f for f, _ in pairs], 2, on_curve=False)
    squares = np.einsum(
        "na,na->n", error, np.linalg.solve(covariance, error[..., None])[..., 0]
    )
    assert abs(squares.mean() - 4) < 4 * np.sqrt(8 / len(squares))


@pytest.mark.parametrize(
    "z",
    [
        lambda x: 80 + 0 * x,
        lambda x: 80 + 0.5 * x,
        lambda x: np.where(x > 19.95, 80.0, 100.0),
    ],
    ids=["level", "slanted", "blade"],
)
def test_a_perfect_plane_has_no_edge_nor_has_a_blade_where_the_profile_ends(z):
    x = np.linspace(-20, 20, 980)
    (feature,) = features_of("edge", [np.stack([x, z(x)], axis=-1)])
    assert feature.reason


def outside(points, ellipse, radius):
    """How far points (..., m, 2) are outside ellipses (..., 4) that planes cut from
    rods, mm, to first order: the distance from the rod's axis, over how fast it grows
    across the ellipse.
    """
    w, axis = points - ellipse[..., None, :2], ellipse[..., 2:, None]
    along = w @ axis
    distance = np.sqrt((w**2).sum(axis=-1) - along[..., 0] ** 2)
    slope = np.linalg.norm(w - along * ellipse[..., None, 2:], axis=-1) / distance
    return (distance - radius) / slope


def off_circle(points, circle):
    return np.hypot(*(points - circle[:2]).T) - circle[2]


def off_face(points, ends):
    along = (ends[1] - ends[0]) / np.hypot(*(ends[1] - ends[0]))
    return (points - ends[0]) @ [-along[1], along[0]]


def of_rods(radius, background):
    """How the rods of a radius are made, what is near them, how far points are off
    them, and the radius.
    """
    return (
        lambda rng: rods(rng, radius=radius, background=background),
        lambda ellipses: ellipses[:, None, :2],
        lambda points, ellipse: outside(points, ellipse, radius),
        radius,
    )


CURVES = {
    "ball": (balls, lambda circles: circles[:, None, :2], off_circle, RADIUS),
    "plane": (planes, lambda faces: faces[:, 1:], off_face, RADIUS),
    "rod, thin": of_rods(5.0, 30.0),
    "rod, thin, alone": of_rods(5.0, None),
    "rod, alone": of_rods(25.0, None),
    "rod, thick": of_rods(60.0, 30.0),
}


@pytest.mark.parametrize("spoiled", [False, True], ids=["clean", "spoiled"])
@pytest.mark.parametrize("curve", CURVES)
def test_curves_are_found_and_as_exact_as_stated(curve, spoiled):
    """No mean is drawn inwards by the bend of its block: their own mean is zero to
    within its standard error.
    """
    make, near, distance, radius = CURVES[curve]
    rng = np.random.default_rng(3)
    profiles, truth = make(rng)
    shown = spoil(profiles, near(truth), rng) if spoiled else profiles
    features = features_of(curve.split(",")[0], shown, radius)
    assert found(features).mean() >= 0.99
    pairs = [
        (f, distance(f.points, where))
        for f, where in zip(features, truth, strict=True)
        if f.found
    ]
    for k in ALONG:
        squares = [off[k] ** 2 / f.covariance[k, 0, 0] for f, off in pairs]
        assert np.mean(squares) == pytest.approx(1, abs=4 * np.sqrt(2 / len(squares)))
    means = np.array([off.mean() for _, off in pairs])
    assert abs(means.mean()) < 4 * means.std() / np.sqrt(len(means))


@pytest.mark.parametrize("lean", [(0.0, 0.0), (0.0, 1.0), (-0.6, 0.3)])
def test_a_section_is_an_ellipse_and_its_distances_have_their_derivatives(lean):
    section = Section(np.array([1.0, 2.0]), np.array(lean), 10.0)
    size, angles = np.hypot(1, np.hypot(*lean)), np.linspace(-3, 3, 50)
    # from the rod seen along its axis
    oblique = np.eye(2) + np.outer(lean, lean) / (1 + size)
    around = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    on = section.centre + 10.0 * around @ oblique
    np.testing.assert_allclose(
        outside(on, np.append(section.centre, section.lean / size), 10.0), 0, atol=1e-12
    )
    off, normals = section.off_and_normals(on)
    np.testing.assert_allclose(off, 0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1)
    along = np.stack([-np.sin(angles), np.cos(angles)], axis=-1) @ oblique
    np.testing.assert_allclose((normals * along).sum(axis=1), 0, atol=1e-12)
    np.testing.assert_allclose(
        section.off_and_normals(on + 1e-4 * normals)[0], 1e-4, atol=1e-8
    )
    assert np.isnan(
        section.off_and_normals(section.centre[None])[0]
    )  # nowhere is outwards

    def off_by(states):
        flat = states.reshape(4, -1).T
        values = [
            Section(state[:2], state[2:], 10.0).off_and_normals(on)[0] for state in flat
        ]
        return np.stack(values, axis=-1).reshape(50, *states.shape[1:])

    numerical = jacobian(off_by, np.concatenate([section.centre, section.lean])).df
    np.testing.assert_allclose(section.derivatives(on), numerical, atol=1e-8)


@pytest.mark.parametrize("radius", [15.0, 40.0])
def test_a_rod_or_ball_of_another_size_is_not_found(radius):
    """A circle up to a quarter larger may pass for a leaning rod, all but its flanks."""
    rng = np.random.default_rng(4)
    assert found(features_of("rod", rods(rng, 100)[0], radius)).mean() < 0.01
    profiles, circles = balls(rng, 100)
    other = np.abs(circles[:, 2] / radius - 1) > 0.25
    assert not found(features_of("rod", profiles[other], radius)).any()


NOTHING = {
    "a table": lambda rng: tables(rng),
    "a spoiled table": lambda rng: spoil(
        tables(rng), np.full((250, 1, 2), np.inf), rng
    ),
    "noise": lambda rng: rng.uniform([-50, 150], [50, 250], (50, 980, 2)),
}


@pytest.mark.parametrize("kind", ["edge", "disk", "ball", "rod"])
@pytest.mark.parametrize("shown", NOTHING)
def test_a_table_or_noise_alone_shows_nothing(kind, shown):
    features = features_of(kind, NOTHING[shown](np.random.default_rng(4)))
    assert found(features).mean() < 0.005
    assert all(
        f.reason and not len(f.used) and f.points.shape == (0, 2)
        for f in features
        if not f.found
    )


def test_where_both_ends_of_a_face_show_the_corner_tells_which_is_the_edge():
    """A narrow bar in front of nothing, its side face seen from few poses."""
    spec = Spec(
        measured="profiles",
        seed=502,
        groups=10,
        positions=4,
        scanner=Scanner(points=300),
    )
    scan = simulate_scan(spec)
    features = features_of("edge", scan.values)
    assert {feature.shape for feature in features if feature.found} == {"corner"}
    assert 0.2 < found(features).mean() < 0.5
    T = np.array(scan.truth["T_flange_sensor"])
    planes = (
        scan.R_base_flange @ T[:3, :3],
        scan.p_base_flange + scan.R_base_flange @ T[:3, 3],
    )
    truth = Edge(**{k: np.array(v) for k, v in scan.truth["target"].items()}).meet(
        *planes
    )
    assert normalised(features, truth[:, None])[0] < 2


@pytest.mark.parametrize(("bevel_deg", "wide"), [(10, 3), (15, 2.5), (20, 2)])
def test_a_bevel_is_no_side_wall(bevel_deg, wide):
    x = np.linspace(-40, 40, 801)
    inside = np.abs(x) < 25
    z = np.where(
        inside,
        100 + np.tan(np.radians(bevel_deg)) * np.maximum(np.abs(x) - 25 + wide, 0),
        120,
    )
    profiles = [
        np.stack([x, z + 0.02 * np.random.default_rng(k).normal(size=801)], axis=-1)
        for k in range(6)
    ]
    for feature in features_of("disk", profiles, RADIUS):
        assert (
            not feature.found or np.abs(np.abs(feature.points[:, 0]) - 25).max() < 0.5
        )


def test_a_profile_recorded_forth_and_back_is_no_disk():
    forth = [profile for profile in disks(np.random.default_rng(1))[0][:6]]
    features = features_of(
        "disk", [np.concatenate([p, p[::-1]]) for p in forth], RADIUS
    )
    assert not found(features).any()


OUTSIDE = {
    "edge": (SHOWN["bar"][2], lambda rng: tables(rng, 200)),
    "disk": (disks, lambda rng: disks(rng, 200, aside=60.0)[0]),
    "ball": (balls, lambda rng: tables(rng, 200)),
    "rod": (rods, lambda rng: tables(rng, 200)),
}


@pytest.mark.parametrize("kind", OUTSIDE)
def test_a_target_outside_the_view_is_not_found_among_profiles_that_show_it(kind):
    """Of the disks aside one tip is in view: where the view ends is not where the disk
    ends.
    """
    inside, outside = OUTSIDE[kind]
    rng = np.random.default_rng(5)
    visible, truth = inside(rng)
    shown = spoil(
        visible[:100], truth[:100].reshape(100, -1, truth.shape[-1])[..., :2], rng
    )
    hidden = spoil(outside(rng), np.full((200, 1, 2), np.inf), rng)
    features = features_of(kind, [*shown, *hidden], RADIUS)
    assert found(features[:100]).mean() >= 0.99
    assert found(features[100:]).mean() < 0.005


def test_a_corner_with_a_side_of_few_points_says_so():
    """A profile with thirty points on one side and six, or three, on the other, among
    good ones.
    """
    rng = np.random.default_rng(9)
    profiles = []
    for count in (40,) * 8 + (6, 3):
        sides = (
            np.stack([-0.5 * np.arange(30, 0, -1), np.zeros(30)], axis=-1),
            np.linspace([0.1, 0.6], [3.0, 18], count),
        )
        profiles.append(
            np.concatenate(sides)
            + np.array([0, 100])
            + rng.normal(0, 0.02, (30 + count, 2))
        )
    features = features_of("edge", profiles)
    assert found(features).tolist() == [True] * 8 + [False] * 2
    assert (
        features[8].reason
        == "one side of the corner shows fewer than 10 points beyond its rounding"
    )
    assert (
        features[9].reason == "one side of the corner shows too few points for a line"
    )


VIEWS = {
    "height for depth": (lambda p: p * [1, -1], lambda t: t * [1, -1]),
    "right for left": (lambda p: p * [-1, 1], lambda t: (t * [-1, 1])[:, ::-1]),
    "last point first": (lambda p: p[:, ::-1], lambda t: t),
}


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("target", ["bar", "disk"])
def test_it_does_not_matter_how_the_scanner_counts(target, view):
    """Orders and signs change the arithmetic's rounding only, which may move a point
    over a threshold: 1e-9 mm.
    """
    kind, _, make = SHOWN[target]
    profiles = make(np.random.default_rng(6))[0][:50]
    change, back = VIEWS[view]
    points, seen = (
        np.array([f.points for f in features_of(kind, shown)])
        for shown in (profiles, change(profiles))
    )
    np.testing.assert_allclose(back(seen), points, atol=1e-9)


def test_points_left_out_of_a_file_are_missing_points():
    rng = np.random.default_rng(7)
    profiles, truth = edges("parallel bar", rng, groups=5)
    dense = features_of("edge", [p[np.isfinite(p).all(axis=1)] for p in profiles])
    ratio, count = normalised(dense, truth)
    assert found(dense).all()
    assert abs(ratio - 1) < 4 / np.sqrt(count)


@pytest.mark.parametrize("kind", ["edge", "disk", "ball", "plane", "rod"])
@pytest.mark.parametrize(
    "profile",
    [
        np.zeros((0, 2)),
        BLANK,
        np.zeros((980, 2)),
        np.ones((1, 2)),
        np.ones((980, 2)),
        BLANK[:4],
    ],
    ids=["no rows", "NaN", "zeros", "one point", "one place", "four rows"],
)
def test_profiles_with_nothing_in_them_have_a_reason(kind, profile):
    (feature,) = features_of(kind, [profile], RADIUS)
    assert not feature.found
    assert feature.reason
    assert feature.used.shape == (0,)


CORRUPTIONS = (
    lambda p, i, j, rng: p[i:j],
    lambda p, i, j, rng: np.concatenate([p[:i], np.full((j - i, 2), np.nan), p[j:]]),
    lambda p, i, j, rng: np.concatenate([p[:i], np.zeros((j - i, 2)), p[j:]]),
    lambda p, i, j, rng: np.concatenate(
        [p[:i], rng.normal(size=(j - i, 2)) * 10.0 ** rng.integers(-3, 4), p[j:]]
    ),
    lambda p, i, j, rng: p * 10.0 ** rng.integers(-4, 5),
    lambda p, i, j, rng: rng.permutation(p),
    lambda p, i, j, rng: np.repeat(p, 2, axis=0)[:2000],
    lambda p, i, j, rng: p[:: rng.integers(1, 40)] * [1, -1],
)


@pytest.mark.parametrize("kind", ["edge", "disk", "ball", "plane", "rod"])
def test_whatever_is_in_a_profile_gives_a_feature_or_a_reason(kind):
    """Warnings are errors here: no division by zero either."""
    rng = np.random.default_rng(10)
    makers = [
        disks,
        balls,
        planes,
        rods,
        lambda rng, _: edges("knife blade", rng, groups=1),
    ]
    profiles = np.concatenate([make(rng, 10)[0] for make in makers])
    for profile in profiles[rng.integers(len(profiles), size=300)]:
        for corrupt in rng.choice(CORRUPTIONS, size=rng.integers(1, 4)):
            i, j = np.sort(rng.integers(0, len(profile) + 1, 2))
            profile = corrupt(profile, i, j, rng)
        (feature,) = features_of(kind, [profile], RADIUS)
        assert feature.found != bool(feature.reason)
        assert np.isfinite(feature.points).all()
        assert (np.linalg.eigvalsh(feature.covariance) >= 0).all()


def test_wrong_input_is_refused_in_words():
    with pytest.raises(
        ValueError, match=r"the ball's radius is None; expected a length in mm"
    ):
        features_of("ball", [BLANK], None)
    with pytest.raises(
        ValueError, match=r"profile 1 has shape \(980, 3\); expected \(n, 2\)"
    ):
        features_of("edge", [BLANK, np.zeros((980, 3))])
