"""Designed plans, against others."""

from dataclasses import replace

import numpy as np
import pytest
from planned import KINDS, setup_for

from profilecal.geometry.poses import rotations
from profilecal.papers.edge_plan import EdgePlan, plan_edge
from profilecal.plan.candidates import Limits, draw, inverse_mount, refused
from profilecal.plan.design import CRITERIA, Pool, exchange, judge, shortest
from profilecal.plan.plan import Wishes, design, design_together, largest
from profilecal.plan.setup import blocks, predict, scales


def pool_of(kind, count, rng):
    setup = setup_for(kind)
    R, T = draw(setup, Limits(), count, rng)
    return Pool.of(R, blocks([(setup, R, T)]), scales([(setup, R, T)])), R, T


@pytest.mark.parametrize("criterion", CRITERIA)
def test_the_value_with_one_more_pose_is_that_of_the_plan_with_it(criterion):
    pool, *_ = pool_of("rod", 40, np.random.default_rng(1))
    chosen = list(range(12))
    values = pool.values_with(pool.covariance(chosen), criterion)
    direct = [pool.value([*chosen, k], criterion) for k in range(40)]
    assert values == pytest.approx(direct, rel=1e-6)


def test_the_smooth_worst_direction_is_the_worst_one_or_a_little_more():
    C = np.diag([1.0, 2, 3, 4, 5, 9])
    assert 3 <= judge(C, "worst") <= 3 * 6 ** (1 / 32)
    assert judge(C, "A") == pytest.approx(2.0)


def test_no_exchange_helps_a_plan_that_was_exchanged():
    pool, *_ = pool_of("edge", 60, np.random.default_rng(2))
    chosen = exchange(pool, list(range(8)), "A", sweeps=30)
    value = pool.value(chosen, "A")
    for place in range(8):
        others = chosen[:place] + chosen[place + 1 :]
        free = np.setdiff1d(np.flatnonzero(~pool.taken(others)), chosen)
        assert all(pool.value([*others, k], "A") > 0.99 * value for k in free)


@pytest.mark.parametrize("kind", [*KINDS, "point"])
def test_a_designed_plan_beats_the_best_of_1000_random_ones(kind):
    rng = np.random.default_rng(3)
    setup, (pool, *_) = setup_for(kind), pool_of(kind, 800, rng)
    plans = [pool.covariance(rng.choice(800, 15, replace=False))[:6, :6] for _ in range(1000)]
    best = np.sqrt(np.linalg.eigvalsh(plans)[:, -1].min())
    plan = design(setup, Wishes(poses=15), rng, candidates=800)
    assert len(plan.T) == 15
    assert (refused(setup, Limits(), plan.R, plan.T) == "").all()
    assert plan.predicted.spectrum.sd[0] < 0.9 * best


@pytest.mark.parametrize("kind", [k for k in (*KINDS, "point") if k != "plane"])
def test_half_of_the_poses_that_random_plans_need(kind):
    rng = np.random.default_rng(4)
    plan = design(setup_for(kind), Wishes(), rng, candidates=800)
    assert plan.enough == len(plan.T)
    pool, *_ = pool_of(kind, 800, rng)
    random = [largest(pool.covariance(rng.choice(800, 2 * len(plan.T), replace=False))[:6, :6]) for _ in range(200)]
    assert np.mean((np.array(random) <= [0.1, 0.05]).all(axis=1)) < 0.5


@pytest.mark.parametrize("kind", ["edge", "ball"])
def test_no_pose_can_be_left_out_of_a_plan_that_is_just_enough(kind):
    setup = setup_for(kind)
    plan = design(setup, Wishes(until=(0.15, 0.08)), np.random.default_rng(6), candidates=400)
    mm, deg = plan.wishes.until
    assert plan.enough == len(plan.T) == plan.predicted.poses
    assert plan.predicted.mm <= mm
    assert plan.predicted.deg <= deg
    for k in range(len(plan.T)):
        fewer = predict([(setup, np.delete(plan.R, k, axis=0), np.delete(plan.T, k, axis=0))])
        assert fewer.mm > mm or fewer.deg > deg


def test_polishing_saves_poses():
    setup, counts = setup_for("edge"), []
    for polishes in (0, 2):
        plan = design(setup, Wishes(until=(0.08, 0.04)), np.random.default_rng(6), candidates=300, polishes=polishes)
        counts.append(len(plan.T))
    assert counts[1] <= 0.85 * counts[0]


def test_the_curve_is_that_of_the_plans_best_poses():
    setup = setup_for("edge")
    plan = design(setup, Wishes(poses=12), np.random.default_rng(6), candidates=300, polishes=1)
    assert sorted(plan.rank) == list(range(1, 13))
    for n, mm, deg in plan.curve[5:]:
        best = predict([(setup, plan.R[plan.rank <= n], plan.T[plan.rank <= n])])
        assert (best.mm, best.deg) == pytest.approx((mm, deg), rel=1e-3)


def test_a_plane_and_a_ball_together_beat_either_alone():
    setups, rng = [setup_for("plane"), setup_for("ball")], np.random.default_rng(3)
    options = {"candidates": 400, "polishes": 1}
    alone = [design(setup, Wishes(poses=12), rng, **options).predicted.spectrum.sd[0] for setup in setups]
    together = design_together(setups, Wishes(poses=12), rng, **options)
    assert [plan.setup for plan in together] == setups
    assert sum(len(plan.T) for plan in together) == 12
    assert min(len(plan.T) for plan in together) >= 3
    assert together[0].predicted.spectrum.sd[0] < 0.9 * min(alone)


def test_25_designed_profiles_beat_the_papers_250_over_an_edge_twofold():
    setup = setup_for("edge")
    paper = plan_edge(EdgePlan(), setup.target, setup.R_sensor, setup.T_sensor, np.random.default_rng(2))
    theirs = predict([(setup, np.repeat(paper.rotations, 10, axis=0), paper.positions.reshape(-1, 3))])
    ours = design(setup, Wishes(poses=25), np.random.default_rng(2)).predicted
    assert theirs.poses == 250
    assert ours.spectrum.sd[0] < theirs.spectrum.sd[0] / 2


def grid_with_tilts(setup):
    """81 positions that face a plane, at 9 heights, and 24 tilted by 20° about alternating axes."""
    facing, origin, height = setup.facing, setup.target.point, np.linspace(80, 220, 9)
    views = [(facing, origin + 20.0 * (i - 4) * facing[:, 0] - h * facing[:, 2]) for i in range(9) for h in height]
    for k in range(24):
        R = facing @ rotations(np.radians(20) * (1 if k % 4 < 2 else -1) * np.eye(3)[k % 2])
        views.append((R, origin - height[k // 4 * 8 // 5] * R[:, 2]))
    return inverse_mount(setup, *map(np.array, zip(*views, strict=True)))


def test_35_designed_poses_know_nothing_worse_than_a_grid_of_105_over_a_plane():
    setup = setup_for("plane")
    grid = predict([(setup, *grid_with_tilts(setup))])
    limits = Limits(extent_mm=80)
    plan = design(setup, Wishes(poses=35, limits=limits), np.random.default_rng(5), reference=grid.covariance)
    ratio = np.linalg.eigvals(np.linalg.solve(grid.covariance, plan.predicted.covariance)).real
    assert ratio.max() < 1


def test_a_plan_after_another_adds_what_that_one_lacks():
    setup, rng = setup_for("edge"), np.random.default_rng(7)
    R, T = draw(setup, Limits(tilt_deg=2, spin_deg=0), 30, rng)
    before = predict([(setup, R, T)])
    plan = design(setup, Wishes(poses=6), rng, [(setup, R, T)])
    assert before.spectrum.status != "ok"
    assert plan.predicted.poses == 36
    assert plan.predicted.mm < 0.2
    assert plan.predicted.spectrum.sd[0] < design(setup, Wishes(poses=6), rng).predicted.spectrum.sd[0]


def test_each_criterion_is_best_at_what_it_asks_for():
    setup = setup_for("edge")
    plans = {name: design(setup, Wishes(poses=12, criterion=name), np.random.default_rng(8)) for name in CRITERIA}
    unit = np.r_[np.full(3, 10.0), np.full(3, np.radians(5))]
    C = {name: plan.predicted.covariance / unit / unit[:, None] for name, plan in plans.items()}
    for name in CRITERIA:
        assert judge(C[name], name) <= 1.05 * min(judge(other, name) for other in C.values())


def test_the_way_is_no_longer_than_before_and_goes_everywhere():
    rng = np.random.default_rng(9)
    R, T = rotations(rng.normal(size=(25, 3))), rng.uniform(-300, 300, (25, 3))
    order = shortest(R, T)
    assert sorted(order) == list(range(25))

    def way(T):
        return np.linalg.norm(np.diff(T, axis=0), axis=1).sum()

    assert way(T[shortest(np.broadcast_to(np.eye(3), (25, 3, 3)), T)]) < 0.7 * way(T)


def test_robot_errors_are_counted():
    setup = setup_for("edge")
    R, T = draw(setup, Limits(), 20, np.random.default_rng(10))
    worse = replace(setup, noise=replace(setup.noise, position_mm=0.5))
    assert predict([(worse, R, T)]).mm > 3 * predict([(setup, R, T)]).mm
