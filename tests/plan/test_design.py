"""Designed plans, against others."""

from dataclasses import replace

import numpy as np
import pytest
from planned import KINDS, model_for

from profilecal.geometry.poses import angle_between, rotations
from profilecal.papers.edge_plan import EdgePlan, plan_edge
from profilecal.plan.candidates import Limits, draw, flange_at, refused
from profilecal.plan.design import Pool, design, exchanged, short_way, smooth_worst
from profilecal.plan.scan_model import predict
from profilecal.scan.scan import ScanError

UNTIL = 0.1, 0.05


def lacks(predicted, until=UNTIL):
    return max(predicted.mm / until[0], predicted.deg / until[1])


def pool_of(kind, count, rng):
    model = model_for(kind)
    return Pool.of(model, *draw(model, Limits(), count, rng), UNTIL)


def test_the_value_with_one_more_pose_is_that_of_the_plan_with_it():
    pool, chosen = pool_of("rod", 40, np.random.default_rng(1)), list(range(12))
    values, fewer = pool.with_each(chosen), pool.with_each(chosen[:1])
    for k in range(12, 40):
        if np.isfinite(values[k]):
            assert values[k] == pytest.approx(smooth_worst(pool.covariance([*chosen, k])[:6, :6]), rel=1e-6)
            both = [np.linalg.det(pool.covariance([*chosen[:1], *more])) for more in ([], [k])]
            assert fewer[k] == pytest.approx(both[1] / both[0], rel=1e-6)
    assert np.isinf(values[:12]).all()  # orientations that the plan has


def test_what_a_pool_says_of_a_plan_is_what_is_predicted():
    model, rng = model_for("edge"), np.random.default_rng(2)
    poses, before = draw(model, Limits(), 15, rng), draw(model, Limits(), 8, rng)
    both = [np.concatenate(pair) for pair in zip(before, poses, strict=True)]
    plan = design(model, Limits(), rng, poses=4, before=before, candidates=200)
    assert plan.predicted.poses == 12
    assert lacks(plan.predicted) < lacks(predict(model, *[part[:12] for part in both]))
    assert Pool.of(model, *poses, UNTIL).lacks(range(15)) == pytest.approx(lacks(predict(model, *poses)), rel=1e-4)


def test_the_smooth_worst_direction_is_the_worst_one_or_a_little_more():
    assert 3 <= smooth_worst(np.diag([1.0, 2, 3, 4, 5, 9])) <= 3 * 6 ** (1 / 32)


def test_no_exchange_helps_a_plan_that_was_exchanged():
    pool, chosen = pool_of("edge", 60, np.random.default_rng(2)), list(range(8))
    for _ in range(30):
        chosen = exchanged(pool, chosen)
    value = smooth_worst(pool.covariance(chosen)[:6, :6])
    assert all(pool.with_each(chosen[:k] + chosen[k + 1 :]).min() > 0.999 * value for k in range(8))


@pytest.mark.parametrize("kind", [*KINDS, "point"])
def test_a_designed_plan_beats_the_best_of_1000_random_ones(kind):
    rng = np.random.default_rng(3)
    model, pool = model_for(kind), pool_of(kind, 800, rng)
    best = min(pool.lacks(rng.choice(800, 15, replace=False)) for _ in range(1000))
    plan = design(model, Limits(), rng, poses=15, candidates=800)
    assert len(plan.T) == 15
    assert (refused(model, Limits(), plan.R, plan.T) == "").all()
    apart = angle_between(plan.R[:, None], plan.R) + 2 * np.eye(15)
    assert np.degrees(apart.min()) >= 1
    assert lacks(plan.predicted) < 0.9 * best


@pytest.mark.parametrize("kind", [k for k in (*KINDS, "point") if k != "plane"])
def test_half_of_the_poses_that_random_plans_need_and_none_too_many(kind):
    model, rng = model_for(kind), np.random.default_rng(4)
    plan = design(model, Limits(), rng, candidates=800)
    n, pool = len(plan.T), pool_of(kind, 800, rng)
    assert lacks(plan.predicted) <= 1
    assert np.mean([pool.lacks(rng.choice(800, 2 * n, replace=False)) <= 1 for _ in range(200)]) < 0.5
    fewer = [predict(model, np.delete(plan.R, k, axis=0), np.delete(plan.T, k, axis=0)) for k in range(n)]
    assert min(map(lacks, fewer)) > 1


def test_25_designed_profiles_beat_the_papers_250_over_an_edge_twofold():
    model = model_for("edge")
    paper = plan_edge(EdgePlan(), model.target, model.R_sensor, model.T_sensor, np.random.default_rng(2))
    theirs = predict(model, np.repeat(paper.rotations, 10, axis=0), paper.positions.reshape(-1, 3))
    ours = design(model, Limits(), np.random.default_rng(2), poses=25).predicted
    assert theirs.poses == 250
    assert lacks(ours) < lacks(theirs) / 2


def test_35_designed_poses_beat_a_grid_of_105_over_a_plane():
    """81 positions that face the plane, at 9 heights, and 24 tilted by 20° about alternating axes."""
    model, height = model_for("plane"), np.linspace(80, 220, 9)
    facing, origin = model.facing, model.target.point
    views = [(facing, origin + 20.0 * (i - 4) * facing[:, 0] - h * facing[:, 2]) for i in range(9) for h in height]
    for k in range(24):
        R = facing @ rotations(np.radians(20) * (1 if k % 4 < 2 else -1) * np.eye(3)[k % 2])
        views.append((R, origin - height[k // 4 * 8 // 5] * R[:, 2]))
    grid = predict(model, *flange_at(model, *map(np.array, zip(*views, strict=True))))
    plan = design(model, Limits(extent_mm=80), np.random.default_rng(5), poses=35)
    assert plan.predicted.mm < grid.mm
    assert plan.predicted.deg < grid.deg


def test_a_plan_after_others_adds_what_those_lack():
    model, rng = model_for("edge"), np.random.default_rng(7)
    before = draw(model, Limits(tilt_deg=2, spin_deg=0), 30, rng)
    plan = design(model, Limits(), rng, poses=6, before=before, candidates=800)
    assert predict(model, *before).spectrum.status != "ok"
    assert plan.predicted.spectrum.status == "ok"
    assert lacks(plan.predicted) < lacks(design(model, Limits(), rng, poses=6, candidates=800).predicted)


def test_the_way_goes_everywhere_and_is_short():
    rng = np.random.default_rng(9)
    R, T = np.broadcast_to(np.eye(3), (25, 3, 3)), rng.uniform(-300, 300, (25, 3))
    order = short_way(R, T)
    assert sorted(order) == list(range(25))
    before, after = (np.linalg.norm(np.diff(T[way], axis=0), axis=1).sum() for way in (range(25), order))
    assert after < 0.7 * before


def test_orientations_that_run_out_are_refused_in_words():
    with pytest.raises(ScanError, match="differs by 1° or more from those of the 1 chosen"):
        design(
            model_for("edge", "points"),
            Limits(tilt_deg=0, spin_deg=0),
            np.random.default_rng(1),
            poses=3,
            candidates=50,
        )


def test_a_plan_that_was_good_enough_already_takes_one_pose():
    model, rng = replace(model_for("edge"), guess=None), np.random.default_rng(8)
    plan = design(model, Limits(), rng, until=(1, 1), before=draw(model, Limits(), 30, rng), candidates=100)
    assert len(plan.T) == 1
