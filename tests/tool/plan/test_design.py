"""Designed plans, against others."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import default_rng
from planned import model_for

from profilecal.geometry.poses import angle_between
from profilecal_tool.plan.candidates import draw, refused
from profilecal_tool.plan.design import (
    Pool,
    design,
    driving_order,
    smooth_worst,
)
from profilecal_tool.plan.scan_model import Limits, predict

UNTIL = 0.1, 0.05


def pool_of(kind, count, rng):
    model = model_for(kind)
    R, T = draw(model, count, rng)
    return Pool(model, R, T, UNTIL)


def test_the_value_with_one_more_pose_is_that_of_the_plan_with_it():
    """While there are too few poses, it is the volume that is left open."""
    pool = pool_of("rod", 40, default_rng(1))
    for chosen in ([0], list(range(12))):
        values = pool.with_each(chosen)
        assert np.isinf(values[chosen]).all()  # orientations that the plan has
        before = np.linalg.det(pool.covariance(chosen))
        for k in np.flatnonzero(np.isfinite(values)):
            longer = [*chosen, k]
            covariance = pool.covariance(longer)
            exact = np.linalg.det(covariance) / before
            if len(chosen) > 1:
                exact = smooth_worst(covariance[:6, :6])
                # the worst or a little more
                assert 1 <= values[k] / pool.lacks(longer) <= 6 ** (1 / 32)
            assert values[k] == pytest.approx(exact, rel=1e-6)


@pytest.mark.parametrize("kind", ["disk", "rod"])
def test_a_designed_plan_beats_the_best_of_1000_random_ones(kind):
    rng = default_rng(3)
    model = model_for(kind)
    pool = pool_of(kind, 800, rng)
    plans = (rng.choice(800, 15, replace=False) for _ in range(1000))
    best = min(map(pool.lacks, plans))
    plan = design(model, rng, poses=15, candidates=400)
    assert len(plan.T) == 15
    assert (refused(model, plan.R, plan.T) == "").all()
    apart = angle_between(plan.R[:, None], plan.R) + 2 * np.eye(15)
    assert np.degrees(apart.min()) >= 1
    assert plan.predicted.lacks(UNTIL) < 0.9 * best


def test_no_pose_is_one_too_many():
    model = model_for("edge")
    plan = design(model, default_rng(4), candidates=400)
    assert plan.predicted.lacks(UNTIL) <= 1
    for k in range(len(plan.T)):
        R, T = (np.delete(part, k, axis=0) for part in (plan.R, plan.T))
        assert predict(model, R, T).lacks(UNTIL) > 1


def test_a_plan_after_others_adds_what_those_lack():
    model, rng = model_for("edge"), default_rng(7)
    narrow = replace(model, limits=Limits(tilt_deg=2, spin_deg=0))
    before = draw(narrow, 30, rng)
    assert predict(model, *before).status != "ok"
    plan = design(replace(model, before=before), rng, poses=6, candidates=400)
    assert plan.predicted.poses == 36
    assert plan.predicted.status == "ok"
    alone = design(model, rng, poses=6, candidates=400)
    assert plan.predicted.lacks(UNTIL) < alone.predicted.lacks(UNTIL)


def test_so_many_poses_like_these_are_enough_and_hardly_fewer():
    pool, chosen = pool_of("edge", 40, default_rng(1)), list(range(12))
    assert pool.enough_poses(chosen, 1.0) == 12
    least, most = (pool.enough_poses(chosen, 1.5) / count for count in (14, 12))
    wanted = pool.lacks(chosen) / 1.5
    assert pool.lacks(chosen, most) <= wanted < pool.lacks(chosen, least)
    assert pool.enough_poses(chosen, 100.0) == 0


def test_the_way_goes_everywhere_is_short_and_passes_each_place_twice():
    R = np.broadcast_to(np.eye(3), (25, 3, 3))
    T = default_rng(9).uniform(-300, 300, (25, 3))
    back = driving_order(R, T)
    assert sorted(back) == list(range(25))
    order = np.empty(25, dtype=int)
    order[::2], order[1::2] = back[:13], back[:12:-1]
    place = np.argsort(order)[back]  # along the way, in the order of driving
    assert abs(np.corrcoef(place, np.arange(25))[0, 1]) < 0.1
    length = np.abs(np.diff(T, axis=0)).sum()
    assert np.abs(np.diff(T[order], axis=0)).sum() < 0.7 * length
