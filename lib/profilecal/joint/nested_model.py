"""The linear model of orientations that have many profiles: the same answers, at a cost
that grows with the number of profiles and not with its square.

Errors of the flange nest: visits in commanded poses, poses in orientations. With E_i
the rows by which an error moves profile i, and S the variances (6) of the error that a
group shares, C never is written out. One error after the other is integrated out, from
the profiles up, and its mean is carried down again.

Leaves, with the errors that no other profile shares, of variances S_own:

    D_i = v_0 + E_i S_own E_iᵀ        [J | c] of a group = Σ E_iᵀ D_i⁻¹ [E_i | Z_i]

Up, for a group with the sum [J | c] of its members, s = √S:

    M = 1 + s J s      K = s M⁻¹ s      it hands on  [J | c] - J K [J | c]
    log |C| = Σ log |D_i| + Σ log |M|

Down, from b = 0 above the coarsest: b is the mean of all errors that a group's members
share, for each column of Z, and Q their covariance, with T = 1 - K J,

    β = M⁻¹ s (c - J b_above)      b = b_above + s β      Q = K + T Q_above Tᵀ
    C⁻¹ Z = D_i⁻¹ (Z_i - E_i b)    (C⁻¹)_ii = D_i⁻¹ - D_i⁻¹ E_i Q E_iᵀ D_i⁻¹
    E_gᵀ C⁻¹ E_g = J - J Q J       E_gᵀ C⁻¹ Z = c - J b
    Zᵀ C⁻¹ Z = Σ (Z_i - E_i b)ᵀ D_i⁻¹ (Z_i - E_i b) + Σ βᵀ β

The last line is a sum of squares: the shorter Σ Zᵀ D⁻¹ Z - Σ cᵀ K c loses digits.
"""

from dataclasses import dataclass

import numpy as np
from numpy import ndarray

from profilecal.joint.linear_model import LinearModel, Posterior
from profilecal.targets.observations import PoseGroups

FEW = 20  # members a group: with more, a product a group is faster than one a member


@dataclass(frozen=True, eq=False)
class Level:
    """The errors that profiles share in groups of one kind: visits, poses or
    orientations. A group of one profile is none: its error is that profile's own.
    """

    errors: ndarray  # (e,) numbers of the errors, from 0
    alone: ndarray  # (profiles,) whether nobody shares the profile's error
    members: ndarray  # (m,) the others, group after group
    starts: ndarray  # (G,) where each group begins among the members
    sizes: ndarray  # (G,)
    parents: ndarray  # (G,) the coarser level's group that holds each

    def of_members(self, values: ndarray) -> ndarray:
        """Values (profiles, ...) of the members."""
        everyone = len(self.members) == len(values)
        return values if everyone else values[self.members]

    def to_members(self, values: ndarray, whole: ndarray) -> ndarray:
        """`whole` (profiles, ...) with what each member has of its group's values (G,
        ...).
        """
        of_members = values.repeat(self.sizes, axis=0)
        if len(self.members) == len(whole):
            return of_members
        whole[self.members] = of_members
        return whole

    @property
    def parts(self) -> list[slice]:
        """The groups' members among all members."""
        ends = zip(self.starts, self.starts + self.sizes, strict=True)
        return [slice(*both) for both in ends]

    @property
    def few(self) -> bool:
        """Whether groups are large: a product a group is faster than one a member."""
        return len(self.members) >= FEW * len(self.starts)

    def sums(self, E: ndarray, rows: ndarray) -> ndarray:
        """Σ E_iᵀ rows_i (G, 6, columns) over each group, of what all profiles have."""
        E, rows = self.of_members(E), self.of_members(rows)
        if not self.few:
            return np.add.reduceat(E.mT @ rows, self.starts, axis=0)
        columns = rows.shape[2]
        products = [
            E[part].reshape(-1, E.shape[2]).T @ rows[part].reshape(-1, columns)
            for part in self.parts
        ]
        return np.array(products)

    def take_off(self, E: ndarray, moves: ndarray, rows: ndarray) -> None:
        """Take E_i times what moves its group (G, 6, columns) off the rows (profiles,
        q, columns) of each member.
        """
        if not self.few:
            rows[self.members] -= self.of_members(E) @ moves.repeat(self.sizes, axis=0)
            return
        everyone = len(self.members) == len(rows)
        for part, move in zip(self.parts, moves, strict=True):
            chosen = part if everyone else self.members[part]
            moved = E[chosen].reshape(-1, E.shape[2]) @ move
            rows[chosen] -= moved.reshape(-1, *rows.shape[1:])


@dataclass(frozen=True)
class Node:
    """All groups of a level, integrated out."""

    level: Level
    s: ndarray  # (6,)
    M_inverse: ndarray  # (G, 6, 6)
    J: ndarray  # (G, 6, 6)
    c: ndarray  # (G, 6, columns)
    b: ndarray  # (G, 6, columns)

    @property
    def K(self) -> ndarray:
        """(G, 6, 6)."""
        return self.s[:, None] * self.M_inverse * self.s


@dataclass(frozen=True)
class Solved:
    """C⁻¹ of rows Z, by its structure."""

    D_inverse: ndarray  # (profiles, q, q)
    X: ndarray  # (profiles, q, columns) C⁻¹ Z
    nodes: list[Node]  # from coarse to fine


class NestedModel(LinearModel):
    """`LinearModel` by the structure of its errors. Rows stand in the order of the
    groups.
    """

    def arrange(self, groups: PoseGroups) -> None:
        """Find what nests in what, and put the profiles in that order."""
        numbers = [groups.sharing(name) for name in self.names]
        counts = np.array([number.max() + 1 for number in numbers], dtype=int)
        kinds = [np.flatnonzero(counts == count) for count in np.unique(counts)]
        coarsest_first = [numbers[kind[0]] for kind in kinds]
        P = len(self.counts)
        self.order = np.lexsort(coarsest_first[::-1]) if kinds else np.arange(P)
        self.levels: list[Level] = []  # from coarse to fine
        holder = np.zeros(P, dtype=int)  # the coarser level's group of each profile
        for kind, number in zip(kinds, coarsest_first, strict=True):
            own = number[self.order]
            alone = np.bincount(own)[own] == 1
            members = np.flatnonzero(~alone)
            starts = np.flatnonzero(np.diff(own[members], prepend=-1))
            sizes = np.diff(np.append(starts, len(members)))
            parents = holder[members[starts]]
            self.levels.append(Level(kind, alone, members, starts, sizes, parents))
            holder[members] = np.arange(len(starts)).repeat(sizes)
        self.set_rows()

    def set_rows(self) -> None:
        """The rows of the profiles kept, in order; zeros for the others."""
        kept = self.kept[self.order][:, None, None]
        self.rows = np.concatenate([self.E, self.Y], axis=2)[self.order] * kept

    def keeping(self, kept: ndarray) -> "NestedModel":
        """The model of some of its profiles (profiles,) only."""
        other = self.to_change()
        other.kept = kept
        other.set_rows()
        return other

    def without_robot(self) -> "NestedModel":
        """The same of a robot that does not err."""
        other = self.to_change()
        other.rest = self.rest + self.Y.mT @ self.Y
        other.rows = self.rows[:0]
        return other

    @property
    def axes(self) -> int:
        """How many directions errors of the flange have."""
        return self.E.shape[2]

    @property
    def row_count(self) -> int:
        """How many rows speak of the flange, those of zeros too."""
        return len(self.rows) * self.q

    def variances(self, errors: ndarray, v: ndarray) -> ndarray:
        """Of the sum of some errors along the flange's six directions, (6,)."""
        return v[1 + errors] @ self.units[errors]

    def solve(self, v: ndarray, EZ: ndarray) -> tuple[ndarray, float, Solved]:
        """Zᵀ C⁻¹ Z of rows [E | Z] (profiles, q, 6 + columns), log |C| and C⁻¹ Z, for
        variances v (1 + k,).
        """
        axes = self.axes
        E, Z = EZ[..., :axes], EZ[..., axes:]
        one, columns = np.eye(axes), Z.shape[2]
        own = np.zeros((len(Z), axes))
        for level in self.levels:
            own += level.alone[:, None] * self.variances(level.errors, v)
        D = v[0] * np.eye(self.q) + (E * own[:, None]) @ E.mT
        D_inverse = np.linalg.inv(D)
        log_det = float(np.linalg.slogdet(D)[1].sum())
        rows = D_inverse @ EZ
        shared = [level for level in self.levels if len(level.members)]
        up = []
        finer, taken = None, np.zeros((0, axes, axes + columns))
        for level in shared[::-1]:
            sums = level.sums(E, rows)
            if finer is not None:
                np.subtract.at(sums, finer.parents, taken)
            J, c = sums[..., :axes], sums[..., axes:]
            s = np.sqrt(self.variances(level.errors, v))
            M = one + s[:, None] * J * s
            M_inverse = np.linalg.inv(M)
            log_det += float(np.linalg.slogdet(M)[1].sum())
            up.append((level, s, M_inverse, J, c))
            own_part = J @ (s[:, None] * M_inverse * s) @ sums
            if finer is not None:
                np.add.at(own_part, finer.parents, taken)
            finer, taken = level, own_part

        products = np.zeros((columns, columns))
        nodes: list[Node] = []
        b = np.zeros((1, axes, columns))
        left = Z.copy()
        for level, s, M_inverse, J, c in up[::-1]:
            above = b[level.parents]
            beta = M_inverse @ (s[:, None] * (c - J @ above))
            products += (beta.mT @ beta).sum(axis=0)
            moves = s[:, None] * beta
            level.take_off(E, moves, left)
            b = above + moves
            nodes.append(Node(level, s, M_inverse, J, c, b))
        X = D_inverse @ left
        products += left.reshape(-1, columns).T @ X.reshape(-1, columns)
        return products, log_det, Solved(D_inverse, X, nodes)

    def add_products(self, v: ndarray, N: ndarray, log_det_C: ndarray) -> list:
        """Add what the rows that speak of the flange say, one set of variances after
        the other. Returns what `gradient` and `left_out` need, of the last one.
        """
        if not len(self.rows):
            return []
        for k, one in enumerate(v):
            products, log_det, solved = self.solve(one, self.rows)
            N[k] += products
            log_det_C[k] += log_det
        return [solved]

    def covariances_of_shared(self, solved: Solved) -> list[ndarray]:
        """Q (G, 6, 6) of each node, from coarse to fine, and of each profile."""
        axes = self.axes
        Q = np.zeros((1, axes, axes))
        of_profiles = np.zeros((len(solved.X), axes, axes))
        of_nodes = []
        for node in solved.nodes:
            T = np.eye(axes) - node.K @ node.J
            Q = node.K + T @ Q[node.level.parents] @ T.mT
            of_nodes.append(Q)
            of_profiles = node.level.to_members(Q, of_profiles)
        return [*of_nodes, of_profiles]

    def inverse_of_own(self, solved: Solved, Q: ndarray) -> ndarray:
        """(C⁻¹)_ii (profiles, q, q)."""
        half = solved.D_inverse @ self.rows[..., : self.axes]
        return solved.D_inverse - half @ Q @ half.mT

    def add_to_gradient(
        self,
        posterior: Posterior,
        slope: ndarray,
        within: ndarray,
        across: ndarray,
    ) -> None:
        """Add what the rows that speak of the flange say, as in `gradient`."""
        if not len(self.rows):
            return
        (solved,) = posterior.last
        n, V = self.n, posterior.covariance[0]
        x = np.append(posterior.mean[0], 1.0)
        E = self.rows[..., : self.axes]
        CA, w = solved.X[..., :n], solved.X @ x
        *Q_of_nodes, Q = self.covariances_of_shared(solved)
        P = self.inverse_of_own(solved, Q) - CA @ V @ CA.mT
        less = P - w[:, :, None] * w[:, None]
        slope[0] += np.einsum("pii->", less)
        F = np.zeros((*w.shape, len(slope)))  # M_k w
        F[..., 0] = w
        diagonals = np.einsum("pqj,pqr,prj->pj", E, less, E)
        by_flange = (E.mT @ w[..., None])[..., 0]
        for level in self.levels:
            own = self.units[level.errors]
            slope[1 + level.errors] += own @ (level.alone @ diagonals)
            alone = level.alone[:, None] * by_flange
            F[..., 1 + level.errors] = E @ (alone[:, None] * own).mT
        for node, Q_node in zip(solved.nodes, Q_of_nodes, strict=True):
            level = node.level
            units = self.units[level.errors]
            EX = node.c - node.J @ node.b
            EA, f = EX[..., :n], EX @ x
            EPE = node.J - node.J @ Q_node @ node.J - EA @ V @ EA.mT
            diagonal = np.einsum("gjj->j", EPE) - np.sum(f**2, axis=0)
            slope[1 + level.errors] += units @ diagonal
            moves = (f[:, None] * units).repeat(level.sizes, axis=0)
            places = level.members[:, None, None], np.arange(self.q)[:, None]
            F[*places, 1 + level.errors] = level.of_members(E) @ moves.mT
        within += self.solve(posterior.v[0], np.concatenate([E, F], axis=2))[0]
        across += CA.reshape(-1, n).T @ F.reshape(-1, len(slope))

    def parts_kept(
        self, posterior: Posterior
    ) -> list[tuple[ndarray, ndarray, ndarray]]:
        """The profiles kept (p,), with (C⁻¹)_bb (p, q, q) and C⁻¹ [A | r] (p, q, n +
        1) of each.
        """
        if not len(self.rows):
            return []
        (solved,) = posterior.last
        *_, Q = self.covariances_of_shared(solved)
        kept = self.kept[self.order]
        inverse = self.inverse_of_own(solved, Q)
        return [(self.order[kept], inverse[kept], solved.X[kept])]
