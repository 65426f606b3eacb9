"""Designed plans, against others."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import default_rng
from planned import KINDS, model_for

from profilecal.geometry.poses import angle_between
from profilecal_tool.plan.candidates import draw, refused
from profilecal_tool.plan.design import (
    Pool,
    design,
    short_way,
    smooth_worst,
    there_and_back,
)
from profilecal_tool.plan.scan_model import Limits, predict

UNTIL = 0.1, 0.05


def lacks(predicted):
    return max(predicted.mm / UNTIL[0], predicted.deg / UNTIL[1])


def pool_of(kind, count, rng):
    model = model_for(kind)
    R, T = draw(model, count, rng)
    return Pool.from_poses(model, R, T, UNTIL)


def random_plan(rng, poses):
    """Some of 800 candidates."""
    return rng.choice(800, poses, replace=False)


def test_the_value_with_one_more_pose_is_that_of_the_plan_with_it():
    pool = pool_of("rod", 40, default_rng(1))
    chosen = list(range(12))
    values = pool.with_each(chosen)
    assert np.isinf(values[:12]).all()  # orientations that the plan has
    for k in np.flatnonzero(np.isfinite(values)):
        longer = [*chosen, k]
        exact = smooth_worst(pool.covariance(longer)[:6, :6])
        assert values[k] == pytest.approx(exact, rel=1e-6)
        # the worst or a little more
        assert 1 <= values[k] / pool.lacks(longer) <= 6 ** (1 / 32)


def test_while_there_are_too_few_poses_the_value_is_the_volume_that_is_left_open():
    pool = pool_of("rod", 40, default_rng(1))
    values = pool.with_each([0])
    before = np.linalg.det(pool.covariance([0]))
    for k in np.flatnonzero(np.isfinite(values)):
        after = np.linalg.det(pool.covariance([0, k]))
        assert values[k] == pytest.approx(after / before, rel=1e-6)


@pytest.mark.parametrize("kind", [*KINDS, "point"])
def test_a_designed_plan_beats_the_best_of_1000_random_ones(kind):
    rng = default_rng(3)
    model = model_for(kind)
    pool = pool_of(kind, 800, rng)
    best = min(pool.lacks(random_plan(rng, 15)) for _ in range(1000))
    plan = design(model, rng, poses=15, candidates=800)
    assert len(plan.T) == 15
    assert (refused(model, plan.R, plan.T) == "").all()
    apart = angle_between(plan.R[:, None], plan.R) + 2 * np.eye(15)
    assert np.degrees(apart.min()) >= 1
    assert lacks(plan.predicted) < 0.9 * best


@pytest.mark.parametrize("kind", ["edge", "disk", "ball", "rod", "point"])
def test_half_of_the_poses_that_random_plans_need_and_none_too_many(kind):
    model = model_for(kind)
    rng = default_rng(4)
    plan = design(model, rng, candidates=800)
    count = len(plan.T)
    assert lacks(plan.predicted) <= 1
    pool = pool_of(kind, 800, rng)
    good = [pool.lacks(random_plan(rng, 2 * count)) <= 1 for _ in range(200)]
    assert np.mean(good) < 0.5
    for k in range(count):
        R = np.delete(plan.R, k, axis=0)
        T = np.delete(plan.T, k, axis=0)
        assert lacks(predict(model, R, T)) > 1


def test_a_plan_after_others_adds_what_those_lack():
    model = model_for("edge")
    rng = default_rng(7)
    narrow = replace(model, limits=Limits(tilt_deg=2, spin_deg=0))
    before = draw(narrow, 30, rng)
    assert predict(model, *before).spectrum.status != "ok"
    plan = design(model, rng, poses=6, before=before, candidates=800)
    assert plan.predicted.poses == 36
    assert plan.predicted.spectrum.status == "ok"
    alone = design(model, rng, poses=6, candidates=800)
    assert lacks(plan.predicted) < lacks(alone.predicted)


def test_a_plan_after_one_that_is_enough_has_one_pose():
    model = model_for("edge")
    rng = default_rng(7)
    enough = draw(model, 30, rng)
    plan = design(model, rng, until=(1, 1), before=enough, candidates=100)
    assert len(plan.T) == 1


def test_the_way_goes_everywhere_is_short_and_passes_each_place_twice():
    R = np.broadcast_to(np.eye(3), (25, 3, 3))
    T = default_rng(9).uniform(-300, 300, (25, 3))
    order = short_way(R, T)
    back = there_and_back(order)
    assert sorted(order) == sorted(back) == list(range(25))
    place = np.argsort(order)[back]  # along the way, in the order of driving
    assert abs(np.corrcoef(place, np.arange(25))[0, 1]) < 0.1
    length = np.abs(np.diff(T, axis=0)).sum()
    assert np.abs(np.diff(T[order], axis=0)).sum() < 0.7 * length
