"""Many profiles of one orientation: the answers of the covariance written out."""

import numpy as np
import pytest

import profilecal as pc
from profilecal.geometry.noise import ROBOT
from profilecal.joint import problem
from profilecal.joint.linear_model import LinearModel
from profilecal.joint.nested_model import FEW, NestedModel
from profilecal.targets.observations import PoseGroups

N = 7  # unknowns
ROWS = 3  # of a profile


def numbered(labels):
    return np.unique(labels, return_inverse=True)[1]


def random_groups(profiles, poses, orientations, rng):
    """Profiles in poses and poses in orientations, some of them alone."""
    pose = numbered(rng.integers(0, poses, profiles))
    orientation = numbered(rng.integers(0, orientations, pose.max() + 1))
    return PoseGroups(pose, orientation, orientation[pose])


def both_models(groups, names, rng):
    """The same random model, written out and by its structure."""
    P = len(groups.pose)
    by_flange = rng.normal(size=(P, ROWS, 6)) * [1, 1, 1, 100, 100, 100]
    by_flange[:, -1] = 0  # no error of the flange moves the last row
    columns = rng.normal(size=(P, ROWS, N + 1))
    precision = np.diag(rng.uniform(1e-6, 1, N))
    given = by_flange, columns, np.full(P, ROWS), groups, names, precision
    return LinearModel(*given), NestedModel(*given)


def assert_same(first, second):
    """To nine digits of the largest entry."""
    atol = 1e-9 * np.abs(first).max()
    np.testing.assert_allclose(second, first, rtol=0, atol=atol)


def assert_same_answers(dense, nested, v):
    for name in ("mean", "covariance", "log_evidence", "square", "normal"):
        posteriors = dense.posterior(v), nested.posterior(v)
        assert_same(*(getattr(posterior, name) for posterior in posteriors))
    posteriors = dense.posterior(v[:1]), nested.posterior(v[:1])
    models = list(zip((dense, nested), posteriors, strict=True))
    for of_model in (LinearModel.gradient, LinearModel.left_out):
        answers = [of_model(model, posterior) for model, posterior in models]
        for first, second in zip(*answers, strict=True):
            assert_same(first, second)


@pytest.mark.parametrize("poses", [8, 30, 300], ids=["crowded", "mixed", "alone"])
@pytest.mark.parametrize("zero", [False, True])
def test_the_structure_gives_the_answers_of_the_dense_covariance(poses, zero):
    """Also of uneven groups, profiles left out, variances of zero, exact robots."""
    rng = np.random.default_rng(poses)
    groups = random_groups(60, poses, 4, rng)
    names = [name for name in ROBOT if name in groups.distinguishable]
    dense, nested = both_models(groups, names, rng)
    v = np.column_stack([np.ones(3), rng.uniform(0, 0.01, (3, len(names)))])
    if zero:
        v[:, 1] = 0.0
    kept = rng.uniform(size=60) > 0.2
    assert_same_answers(dense, nested, v)
    assert_same_answers(dense.keeping(kept), nested.keeping(kept), v)
    assert_same_answers(dense.without_robot(), nested.without_robot(), v)


def test_few_large_groups_are_summed_as_many_small_ones_are():
    rng = np.random.default_rng(1)
    groups = random_groups(6 * FEW, 6 * FEW, 2, rng)
    names = ["position_mm", "group_position_mm"]
    assert_same_answers(*both_models(groups, names, rng), np.full((2, 3), 0.5))


@pytest.mark.parametrize("kind", ["edge", "ball"])
def test_a_calibration_is_the_same_either_way(kind, monkeypatch):
    scan, _ = pc.simulate(kind, seed=1, groups=4, positions=20, repeats=2)
    answers = []
    for many in (10, 1000):
        monkeypatch.setattr(problem, "MANY", many)
        answers.append(pc.calibrate(scan))
    assert answers[0].poses_used == answers[1].poses_used
    assert_same(answers[0].pose, answers[1].pose)
    assert_same(answers[0].covariance_mm_deg, answers[1].covariance_mm_deg)
