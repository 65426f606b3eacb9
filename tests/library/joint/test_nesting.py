"""Groups within groups: the answers of the covariance written out."""

import numpy as np
import pytest

from profilecal.geometry.noise import ROBOT
from profilecal.joint import linear_model
from profilecal.joint.linear_model import LinearModel
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


class WrittenOut:
    """A random model, and all its rows with their covariance."""

    def __init__(self, groups, names, rng):
        P = len(groups.pose)
        F = rng.normal(size=(P, ROWS, 6)) * [1, 1, 1, 100, 100, 100]
        F[:, -1] = 0  # no error of the flange moves the last row
        Y = rng.normal(size=(P, ROWS, N + 1))
        self.precision = np.diag(rng.uniform(1e-6, 1, N))
        counts = np.full(P, ROWS)
        self.model = LinearModel(F, Y, counts, groups, names, self.precision)
        self.Y, F = Y.reshape(-1, N + 1), F.reshape(-1, 6)
        self.M = [np.eye(len(F))]
        for name in names:
            number = groups.sharing(name).repeat(ROWS)
            moves = F[:, :3] if name.endswith("mm") else np.radians(F[:, 3:])
            self.M.append(moves @ moves.T * (number[:, None] == number))

    def answers(self, v, kept):
        """Of the profiles kept: mean, covariance, [A | r]ᵀ C⁻¹ [A | r], the gradient of
        the log evidence and its average information.
        """
        rows = kept.repeat(ROWS)
        M = [M_k[np.ix_(rows, rows)] for M_k in self.M]
        inverse = np.linalg.inv(np.tensordot(v, M, 1))
        A, r = self.Y[rows, :N], self.Y[rows, N]
        V = np.linalg.inv(A.T @ inverse @ A + self.precision)
        x = -V @ A.T @ inverse @ r
        P = inverse - inverse @ A @ V @ A.T @ inverse
        F = np.array([M_k @ P @ r for M_k in M])
        slope = [np.sum(P * M_k) - r @ P @ f for M_k, f in zip(M, F, strict=True)]
        normal = self.Y[rows].T @ inverse @ self.Y[rows]
        return x, V, normal, -np.array(slope) / 2, F @ P @ F.T / 2

    def same(self, v, kept):
        """The model's answers."""
        model = self.model.keeping(kept)
        posterior = model.posterior(v[None])
        known = posterior.mean, posterior.covariance, posterior.normal
        return *(one[0] for one in known), *model.gradient(posterior)


def assert_same(first, second):
    """To nine digits of the largest entry."""
    atol = 1e-9 * np.abs(first).max()
    np.testing.assert_allclose(second, first, rtol=0, atol=atol)


@pytest.mark.parametrize("poses", [8, 30, 300], ids=["crowded", "mixed", "alone"])
@pytest.mark.parametrize("zero", [False, True])
def test_the_structure_gives_the_answers_of_the_dense_covariance(poses, zero):
    """Of uneven groups, some of one profile, profiles left out, variances of zero."""
    rng = np.random.default_rng(poses)
    groups = random_groups(60, poses, 4, rng)
    names = [name for name in ROBOT if name in groups.distinguishable]
    written_out = WrittenOut(groups, names, rng)
    v = np.r_[1.0, rng.uniform(0, 0.01, len(names))]
    if zero:
        v[1] = 0.0
    for kept in (np.full(60, True), rng.uniform(size=60) > 0.2):
        both = written_out.answers(v, kept), written_out.same(v, kept)
        for first, second in zip(*both, strict=True):
            assert_same(first, second)


def test_several_sets_of_variances_are_one_after_the_other(monkeypatch):
    """However many are looked at together."""
    rng = np.random.default_rng(1)
    names = [*ROBOT]
    model = WrittenOut(random_groups(40, 20, 3, rng), names, rng).model
    v = rng.uniform(0.5, 1, (5, 1 + len(names)))
    alone = [model.posterior(one[None]).log_evidence[0] for one in v]
    for numbers in (2 * model.rows.size, 10 * model.rows.size):
        monkeypatch.setattr(linear_model, "AT_ONCE", numbers)
        np.testing.assert_allclose(model.posterior(v).log_evidence, alone, rtol=1e-12)
