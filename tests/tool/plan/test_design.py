"""Designed plans, against others."""

import numpy as np
import pytest
from planned import KINDS, model_for

from profilecal.geometry.poses import angle_between
from profilecal_tool.plan.candidates import Limits, draw, refused
from profilecal_tool.plan.design import Pool, design, short_way, smooth_worst
from profilecal_tool.plan.scan_model import predict

UNTIL = 0.1, 0.05


def lacks(predicted):
    return max(predicted.mm / UNTIL[0], predicted.deg / UNTIL[1])


def pool_of(kind, count, rng):
    model = model_for(kind)
    return Pool.from_poses(model, *draw(model, Limits(), count, rng), UNTIL)


def test_the_value_with_one_more_pose_is_that_of_the_plan_with_it():
    pool, chosen = pool_of("rod", 40, np.random.default_rng(1)), list(range(12))
    values, fewer = pool.with_each(chosen), pool.with_each(chosen[:1])
    for k in range(12, 40):
        if np.isfinite(values[k]):
            assert values[k] == pytest.approx(
                smooth_worst(pool.covariance([*chosen, k])[:6, :6]), rel=1e-6
            )
            both = [
                np.linalg.det(pool.covariance([*chosen[:1], *more]))
                for more in ([], [k])
            ]
            assert fewer[k] == pytest.approx(both[1] / both[0], rel=1e-6)
            assert (
                1 <= values[k] / pool.lacks([*chosen, k]) <= 6 ** (1 / 32)
            )  # the worst or a little more
    assert np.isinf(values[:12]).all()  # orientations that the plan has


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
    assert (
        np.mean(
            [pool.lacks(rng.choice(800, 2 * n, replace=False)) <= 1 for _ in range(200)]
        )
        < 0.5
    )
    fewer = [
        predict(model, np.delete(plan.R, k, axis=0), np.delete(plan.T, k, axis=0))
        for k in range(n)
    ]
    assert min(map(lacks, fewer)) > 1


def test_a_plan_after_others_adds_what_those_lack():
    model, rng = model_for("edge"), np.random.default_rng(7)
    before = draw(model, Limits(tilt_deg=2, spin_deg=0), 30, rng)
    plan = design(model, Limits(), rng, poses=6, before=before, candidates=800)
    assert plan.predicted.poses == 36
    assert predict(model, *before).spectrum.status != "ok"
    assert plan.predicted.spectrum.status == "ok"
    assert lacks(plan.predicted) < lacks(
        design(model, Limits(), rng, poses=6, candidates=800).predicted
    )
    whole = [
        np.concatenate(pair) for pair in zip(before, (plan.R, plan.T), strict=True)
    ]
    assert (
        len(design(model, Limits(), rng, until=(1, 1), before=whole, candidates=100).T)
        == 1
    )  # one at least


def test_the_way_goes_everywhere_and_is_short():
    R, T = (
        np.broadcast_to(np.eye(3), (25, 3, 3)),
        np.random.default_rng(9).uniform(-300, 300, (25, 3)),
    )
    order = short_way(R, T)
    assert sorted(order) == list(range(25))
    assert (
        np.abs(np.diff(T[order], axis=0)).sum() < 0.7 * np.abs(np.diff(T, axis=0)).sum()
    )
