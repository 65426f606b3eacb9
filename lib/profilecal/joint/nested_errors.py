"""The covariance C of rows that share errors of the flange, by its structure.

C never is written out. Errors of the flange nest: visits in commanded poses, poses in
orientations. With E_i the rows by which an error moves profile i, and v_g the
variances of the error that a group shares, one error after the other is integrated out,
from the profiles up, and its mean is carried down again.

Leaves, with the errors that no other profile shares, of variances v_own:

    D_i = v_0 + E_i v_own E_iᵀ = L_i L_iᵀ      D_E = D_i⁻¹ E_i
    [J | c] of a group = Σ D_Eᵀ [E_i | Z_i]

Up, for a group with the sum [J | c] of its members, s = √v_g:

    M = 1 + s J s      K = s M⁻¹ s      log |C| = Σ log |D_i| + Σ log |M|

Integrating out the error of the group takes J K [J | c] off its sum. The next coarser
group has the sum over its members of

    [J | c] - J K [J | c] = s⁻¹ M⁻¹ s [J | c]

where the right side loses no digits.

Down, from b = 0 above the coarsest: b is the mean of the sum of all errors that the
members of a group share, for each column of Z, and Q the covariance of that sum, with
T = 1 - K J,

    β = M⁻¹ s (c - J b_above)      b = b_above + s β      Q = K + T Q_above Tᵀ
    W = L_i⁻¹ (Z_i - E_i b)      (C⁻¹ Z)_i = L_i⁻ᵀ W      (C⁻¹)_ii = D_i⁻¹ - D_E Q D_Eᵀ
    E_gᵀ C⁻¹ E_g = J - J Q J       E_gᵀ C⁻¹ Z = s⁻¹ β
    Zᵀ C⁻¹ Z = Σ |W|² + Σ |β|²

The last line is a sum of squares: the shorter Σ Zᵀ D⁻¹ Z - Σ cᵀ K c loses digits.

In shapes, q is the most rows that a profile has, and a an error's directions: 6, or 7
in motion. Of a profile, E_i is (q, a), Z_i (q, columns), D_i (q, q); of a group, J, M,
K and Q are (a, a), c, b and β (a, columns), s (a,).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy import ndarray

from profilecal.joint.nesting import Level, Nesting, add_up, in_parts


@dataclass(frozen=True)
class Rows:
    """The rows of all profiles kept, in bundles of a `size` at most
    (`Nesting.bundles`), zeros where there are fewer profiles, and the parts of their D:
    by the scanner's noise, and by each error that no other profile shares.
    """

    groups: ndarray  # (bundles,)
    profiles: ndarray  # (bundles, size); -1: none
    E: ndarray  # (bundles, size, q, a)
    Z: ndarray  # (bundles, size, q, columns)
    parts: ndarray  # (errors, bundles, size, q, q)
    errors: list[int]  # their numbers: 0 is the scanner's noise
    nesting: Nesting
    unit_variances: ndarray  # (1 + k, a) for one unit of each of v

    def factors(self, v: ndarray) -> "Factors":
        """C for variances v (S, 1 + k)."""
        count, (bundles, size, q, a) = len(v), self.E.shape
        D = v[:, self.errors] @ self.parts.reshape(len(self.errors), -1)
        root, log_det = inverse_root(D.reshape(count, -1, q, q))
        root = root.reshape(count, *self.parts.shape[1:])
        D_E = (root.mT @ (root @ self.E)).reshape(count, bundles, size * q, a)
        sums = np.zeros((count, self.nesting.count, a, a))
        add_up(sums, self.groups, D_E.mT @ self.E.reshape(D_E.shape[1:]))
        nodes = []
        for level in self.nesting.levels[::-1]:
            J = sums[:, level.groups]
            # above zero, as the sums for the coarser groups are divided by s
            s = np.sqrt(v[:, level.errors] @ self.unit_variances[level.errors]) + 1e-100
            s = s[:, None, :, None]
            M_root, of_groups = inverse_root(np.eye(a) + s * J * s.mT)
            log_det += of_groups
            Ms = (M_root.mT @ M_root) * s.mT
            nodes.append(Node(level, J, s, Ms))
            if level is not self.nesting.levels[0]:  # which no group holds
                add_up(sums, level.parents, Ms @ J / s)
        return Factors(self, root, D_E, nodes[::-1], log_det)


@dataclass(frozen=True)
class Node:
    """All G groups of a level, integrated out, for S sets of variances."""

    level: Level
    J: ndarray  # (S, G, a, a)
    s: ndarray  # (S, 1, a, 1)
    Ms: ndarray  # (S, G, a, a) M⁻¹ s


@dataclass(frozen=True)
class Factors:
    """C for S sets of variances: of each profile, and of each level of groups."""

    rows: Rows
    root: ndarray  # (S, bundles, size, q, q) L_i⁻¹
    D_E: ndarray  # (S, bundles, size q, a)
    nodes: list[Node]  # from coarse to fine
    log_det: ndarray  # (S,) log |C|

    def solve(self, Z: ndarray) -> tuple[ndarray, ndarray, ndarray]:
        """For rows Z (bundles, size, q, columns): Zᵀ C⁻¹ Z (S, columns, columns), and b
        and β (S, groups, a, columns).
        """
        count, *rows, a = self.D_E.shape
        columns = Z.shape[-1]
        of_bundles = Z.reshape(*rows, columns)
        c = np.zeros((count, self.rows.nesting.count, a, columns))
        for part in in_parts(Z):
            sums = self.D_E[:, part].mT @ of_bundles[part]
            add_up(c, self.rows.groups[part], sums)
        # from fine to coarse, without the coarsest, which no group holds
        for node in self.nodes[:0:-1]:
            add_up(c, node.level.parents, node.Ms @ c[:, node.level.groups] / node.s)

        b = np.zeros_like(c)
        # group 0 shares nothing: the sum of its members, if any was added, is dropped
        c[:, 0] = 0.0
        for node in self.nodes:
            groups, above = node.level.groups, np.zeros(1)
            own = c[:, groups]
            if node is not self.nodes[0]:
                above = b[:, node.level.parents]
                own -= node.J @ above
            own[:] = node.Ms @ own  # β, which takes the place of c
            b[:, groups] = above + node.s * own
        products = squares(c)
        for part in in_parts(Z):
            products += squares(self.whitened(Z, b, part))
        return products, b, c

    def whitened(self, Z: ndarray, b: ndarray, part: slice) -> ndarray:
        """W (S, some, size, q, columns) of some bundles. Those of all would take as
        much memory as all rows, for each set of variances.
        """
        Z, E = Z[part], self.rows.E[part].reshape(-1, *self.D_E.shape[2:])
        # a product for each bundle is faster than one for each profile
        moved = E @ b[:, self.rows.groups[part]]
        return self.root[:, part] @ (Z - moved.reshape(-1, *Z.shape))

    @cached_property
    def covariances(self) -> ndarray:
        """Q (groups, a, a), for the first set of variances."""
        a = self.D_E.shape[-1]
        Q = np.zeros((self.rows.nesting.count, a, a))
        for node in self.nodes:
            K = (node.s * node.Ms)[0]
            T = np.eye(a) - K @ node.J[0]
            Q[node.level.groups] = K + T @ Q[node.level.parents] @ T.mT
        return Q


def inverse_root(C: ndarray) -> tuple[ndarray, ndarray]:
    """L⁻¹ of matrices C = L Lᵀ (S, G, size, size), and the sums (S,) of their log |C|.

    Elimination takes [C | 1] to [Lᵀ | L⁻¹], for all matrices at once: S and G are the
    last axes, so that NumPy's inner loops run over them.
    """
    size = C.shape[-1]
    A = np.zeros((size, 2 * size, *C.shape[:2]))
    A[:, :size] = C.transpose(2, 3, 0, 1)
    for j in range(size):
        rows = A[j:, j : size + j + 1]
        row, below = rows[0], rows[1:]
        row[-1] = 1.0
        row /= np.sqrt(row[0])
        below -= row[1 : size - j, None] * row
    root = np.ascontiguousarray(A[:, size:].transpose(2, 3, 0, 1))
    return root, 2 * np.log(np.diagonal(A)).sum(axis=(1, 2))


def flat(rows: ndarray) -> ndarray:
    """Rows (..., columns) of profiles, one after the other: (rows, columns)."""
    return rows.reshape(-1, rows.shape[-1])


def squares(rows: ndarray) -> ndarray:
    """Σ rowsᵀ rows (S, columns, columns) of rows (S, ..., columns)."""
    of_set = rows.reshape(len(rows), -1, rows.shape[-1])
    return of_set.mT @ of_set
