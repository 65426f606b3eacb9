"""One calibration for every target: the sensor pose and all placements in one maximum-likelihood step.

Unknown are the sensor pose (6) and where each target is (edge 4, disk 5, ball 3, plane 3, point 3). A residual is an
observed point minus where the scan plane meets the target, in the scan plane. Each target file offers `residual` and
its derivatives in the *sensor* frame; everything else is the same for all of them and is written once, here.

The sensor pose is perturbed as T · exp(δ), δ = (ρ, φ) in the sensor's frame: a point at p there moves to
p - ρ + p × φ, a direction d to d + d × φ. Every function takes a batch of problems along the leading axis.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi2 as chi2_law

from profilecal.targets import ball, disk, edge, plane, point

TARGETS = {"edge": edge, "disk": disk, "ball": ball, "plane": plane, "point": point}
CAUCHY = 2.385  # noise levels at which a residual's weight is a half: 95 % efficient on clean data (Rey 1983)


@dataclass(frozen=True)
class Noise:
    """Standard deviations, one per axis; `profile_mm` None: to be estimated."""

    profile_mm: float | None = None  # scanner, in x and in z
    position_mm: float = 0.0  # robot, fresh at each pose
    orientation_deg: float = 0.0
    group_position_mm: float = 0.0  # robot, shared by the poses of a rotation group
    group_orientation_deg: float = 0.0
    steering_mm: float = 0.0  # marked points only: how far the operator leaves the scan plane from the point

    def pose_variances(self) -> np.ndarray:
        """Of the six components of a flange pose's own error, mm² and rad²."""
        return np.repeat([self.position_mm, np.radians(self.orientation_deg)], 3) ** 2

    def group_variances(self) -> np.ndarray:
        """Of the six components of the error that a rotation group shares, mm² and rad²."""
        return np.repeat([self.group_position_mm, np.radians(self.group_orientation_deg)], 3) ** 2


@dataclass(frozen=True)
class Observations:
    """What the scanner saw of one target from P flange poses; leading axes are a batch of problems."""

    kind: str  # edge, disk, ball, plane or point
    R_flange: np.ndarray  # (..., P, 3, 3) flange in the base frame; eye-to-hand: base in the flange frame
    T_flange: np.ndarray  # (..., P, 3) mm
    points: np.ndarray  # (..., P, m, 2) x and z; edge, point m = 1, disk m = 2 (tips, by x); NaN: none
    size: float | None = None  # radius of disk and ball, mm
    group: np.ndarray | None = None  # (P,) poses of one flange orientation share a number
    eye_to_hand: bool = False

    def __post_init__(self):
        if self.kind not in TARGETS:
            raise ValueError(f"kind is {self.kind!r}; expected one of {', '.join(TARGETS)}")
        if self.kind in ("ball", "disk") and not (self.size and self.size > 0):
            raise ValueError(f"the {self.kind}'s radius is {self.size}; expected a length in mm")
        shape, count = np.shape(self.points), {"edge": 1, "point": 1, "disk": 2}.get(self.kind)
        if len(shape) < 3 or shape[-1] != 2 or (count and shape[-2] != count):
            raise ValueError(f"points of the {self.kind} have shape {shape}; expected (..., poses, {count or 'm'}, 2)")
        for name, value, tail in (("R_flange", self.R_flange, (3, 3)), ("T_flange", self.T_flange, (3,))):
            if np.shape(value)[-1 - len(tail) :] != (shape[-3], *tail):
                raise ValueError(f"{name} has shape {np.shape(value)}; expected (..., {shape[-3]}, {tail})")
            if not np.isfinite(value).all():
                raise ValueError(f"{name} holds a value that is not finite; expected a pose for every profile")
        if self.group is not None and np.shape(self.group) != (shape[-3],):
            raise ValueError(f"group has shape {np.shape(self.group)}; expected ({shape[-3]},), one label per pose")

    def keep(self, poses) -> "Observations":
        """Only some poses, by mask or index."""
        group = None if self.group is None else np.asarray(self.group)[poses]
        return replace(
            self,
            R_flange=self.R_flange[..., poses, :, :],
            T_flange=self.T_flange[..., poses, :],
            points=self.points[..., poses, :, :],
            group=group,
        )


@dataclass(frozen=True)
class State:
    """Sensor pose (B, 3, 3), (B, 3) and one placement (point, direction), both (B, 3), for each target."""

    rotation: np.ndarray
    translation: np.ndarray
    placements: tuple

    def __getitem__(self, chosen) -> "State":
        placements = tuple((p[chosen], d[chosen]) for p, d in self.placements)
        return State(self.rotation[chosen], self.translation[chosen], placements)

    @staticmethod
    def where(mask, first: "State", second: "State") -> "State":
        """`first` where the mask (B,) holds, `second` elsewhere."""

        def pick(a, b):
            return np.where(mask.reshape(-1, *[1] * (a.ndim - 1)), a, b)

        pairs = zip(first.placements, second.placements, strict=True)
        placements = tuple((pick(p, q), pick(d, e)) for (p, d), (q, e) in pairs)
        return State(pick(first.rotation, second.rotation), pick(first.translation, second.translation), placements)


def across(direction):
    """Two unit vectors (..., 2, 3) perpendicular to unit vectors (..., 3) and to each other."""
    aside = np.eye(3)[np.argmin(np.abs(direction), axis=-1)]
    first = np.cross(direction, aside)
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    return np.stack([first, np.cross(direction, first)], axis=-2)


def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


class Term:
    """One target's observations, arranged for speed: poses along the last axis, a batch axis B (or 1) first."""

    def __init__(self, observations: Observations, noise: Noise):
        self.module = TARGETS[observations.kind]
        self.size = observations.size
        if observations.kind == "point":
            self.size = noise.profile_mm / noise.steering_mm if noise.steering_mm and noise.profile_mm else 1.0
        R, T, points = (np.asarray(a, float) for a in (observations.R_flange, observations.T_flange, observations.points))
        self.P = points.shape[-3]
        R, T = R.reshape(-1, self.P, 3, 3), T.reshape(-1, self.P, 3)
        points = points.reshape(-1, *points.shape[-3:])
        self.turn = np.ascontiguousarray(R.transpose(0, 2, 3, 1)).reshape(-1, 3, 3 * self.P)  # (B|1, 3, 3P)
        self.shift = np.einsum("npab,npa->nbp", R, T)  # Rᵀ T, (B|1, 3, P)
        seen = np.ascontiguousarray(points.transpose(2, 3, 0, 1))  # (m, 2, B|1, P)
        missing = ~np.isfinite(seen).all(axis=1)  # (m, B|1, P)
        self.present = None
        if missing.any():
            seen = np.where(missing[:, None], 0.0, seen)
            self.present = ~missing
        self.seen, self.eye_to_hand = seen, observations.eye_to_hand
        self.moves, self.turns = self.module.MOVES, self.module.TURNS
        self.n = {"across": 2, "along": 1, "anywhere": 3}[self.moves] + 2 * self.turns
        group = np.arange(self.P) if observations.group is None else observations.group
        self.group = np.unique(group, return_inverse=True)[1]

    def moving(self, placement):
        """The directions in which the placement's point moves and in which its direction turns, (B, ·, 3) each."""
        place, direction = placement
        turning = across(direction) if self.turns else np.zeros((len(place), 0, 3))
        if self.moves == "across":
            return turning, turning
        if self.moves == "along":
            return direction[:, None], turning
        return np.broadcast_to(np.eye(3), (len(place), 3, 3)), turning

    def linearise(self, state: State, placement, in_plane: bool, with_robot: bool = False):
        """Derivatives by the sensor pose (6) and the placement (n), the residual, and if asked for the derivatives by
        the flange pose (6): (B, columns, K, P). And which residuals there are: None (all), or 0 and 1, (B, K, P)."""
        points, turning = self.moving(placement)
        vectors = np.concatenate([placement[0][:, None], placement[1][:, None], points, turning], axis=1)
        B = len(vectors)
        local = (vectors @ self.turn).reshape(B, -1, 3, self.P)  # in the flange frames
        local[:, 0] -= self.shift + state.translation[:, :, None]
        local = np.swapaxes(state.rotation, 1, 2)[:, None] @ local  # in the sensor frames
        p, d = np.moveaxis(local[:, 0], 1, 0), np.moveaxis(local[:, 1], 1, 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            r, by_point, by_direction = self.module.residual(p, d, self.seen, self.size, in_plane)

        K, q = len(r), points.shape[1]
        z = np.empty((B, 7 + self.n + 6 * with_robot, K, self.P))
        for k in range(K):
            P = by_point[k]
            for j in range(3):
                np.negative(P[j], out=z[:, j, k])
            turn = _cross(P, p)
            if self.turns:
                D = by_direction[k]
                turn = [a + b for a, b in zip(turn, _cross(D, d), strict=True)]
            for j in range(3):
                z[:, 3 + j, k] = turn[j]
            for j in range(q):
                z[:, 6 + j, k] = _dot(P, np.moveaxis(local[:, 2 + j], 1, 0))
            for j in range(turning.shape[1]):
                z[:, 6 + q + j, k] = _dot(D, np.moveaxis(local[:, 2 + q + j], 1, 0))
            z[:, 6 + self.n, k] = r[k]
        if with_robot:
            arm = state.translation[:, :, None] + (self.shift if self.eye_to_hand else 0)
            arm = np.moveaxis(np.swapaxes(state.rotation, 1, 2) @ arm, 1, 0)[:, :, None]  # flange to sensor, (3, B, 1, P)
            z[:, -6:-3] = z[:, :3]
            lever = _cross(arm, np.moveaxis(z[:, :3], 1, 0))
            for j in range(3):
                z[:, -3 + j] = z[:, 3 + j] + lever[j]
        present = None
        if self.present is not None:
            present = np.moveaxis(np.repeat(self.present, K // len(self.present), axis=0), 0, 1)
            z *= present[:, None]
        return z, present


def _whiten(M, variances):
    """Moments M (..., N, N) whose last six columns are a common error with these variances, with that error
    marginalised (Woodbury): M - M_E Σ (1 + M_EE Σ)⁻¹ M_Eᵀ."""
    E = M[..., -6:]
    inner = np.eye(6) + E[..., -6:, :] * variances
    return M - (E * variances) @ np.linalg.solve(inner, np.swapaxes(E, -1, -2))


class Problem:
    """All terms with their noise. `noise.profile_mm` must be known here; it may be an array (B,)."""

    def __init__(self, observations: Sequence[Observations], noise: Noise):
        self.terms = [Term(entry, noise) for entry in observations]
        self.sigma = np.asarray(noise.profile_mm, dtype=float).reshape(-1, 1, 1)
        self.of_pose, self.of_group = noise.pose_variances(), noise.group_variances()
        self.has_group = bool(self.of_group.any())
        self.has_robot = bool(self.of_pose.any()) or self.has_group
        self.n = 6 + sum(term.n for term in self.terms)

    def count(self) -> np.ndarray:
        """How many residuals, (1,) or (B,)."""
        total = 0
        for term in self.terms:
            rows = {"edge": 2, "disk": 4, "point": 3}.get(term.module.__name__.rsplit(".", 1)[1])
            if term.present is None:
                total = total + np.array([(rows or len(term.seen)) * term.P])
            else:
                total = total + term.present.sum(axis=(0, 2)) * ((rows or len(term.seen)) // len(term.seen))
        return total

    def moments(self, state: State, scale=None, in_plane: bool = True, weights=None):
        """(M, loss, chi2): normal equations [J r]ᵀ C⁻¹ [J r], (B, n + 1, n + 1), the loss (B,), and each pose's own
        χ² per residual, one (B, P) for each target.

        `scale` (B,): Cauchy's loss with that many noise levels as its unit; None: least squares. `weights`: one
        (B, P) or (P,) for each target.
        """
        B = len(state.rotation)
        total, loss, per_pose = np.zeros((B, self.n + 1, self.n + 1)), np.zeros(B), []
        start = 6
        for index, (term, placement) in enumerate(zip(self.terms, state.placements, strict=True)):
            z, present = term.linearise(state, placement, in_plane, self.has_robot)
            K = z.shape[2]
            count = K if present is None else np.maximum(present.sum(axis=1), 1)
            weight = None if weights is None else np.asarray(weights[index], dtype=float)
            if not self.has_robot:
                r = z[:, -1]
                own = np.einsum("bkp,bkp->bp", r, r) / self.sigma[..., 0] ** 2 / count
                if scale is not None:
                    weight = (1 if weight is None else weight) / (1 + own / (CAUCHY * scale[:, None]) ** 2)
                if weight is not None:
                    z *= np.sqrt(np.broadcast_to(weight, own.shape))[:, None, None]
                flat = z.reshape(B, z.shape[1], -1)
                M = flat @ np.swapaxes(flat, 1, 2) / self.sigma**2
            else:
                y = np.ascontiguousarray(z.transpose(0, 3, 1, 2))  # (B, P, N, K)
                M = y @ np.swapaxes(y, 2, 3) / self.sigma[..., None] ** 2
                own = _whiten(M, self.of_pose + self.of_group)[..., -7, -7] / count
                M = _whiten(M, self.of_pose)
                if scale is not None:
                    weight = (1 if weight is None else weight) / (1 + own / (CAUCHY * scale[:, None]) ** 2)
                if weight is not None:
                    M = M * np.broadcast_to(weight, own.shape)[..., None, None]
                if self.has_group:
                    member = np.arange(term.group.max() + 1)[:, None] == term.group
                    M = (member.astype(float) @ M.reshape(B, term.P, -1)).reshape(B, -1, *M.shape[2:])
                    M = _whiten(M, self.of_group)
                M = M.sum(axis=1)[..., :-6, :-6]
            if scale is None:
                loss += M[:, -1, -1]
            else:
                unit = (CAUCHY * scale[:, None]) ** 2
                kept = 1 if weights is None else np.asarray(weights[index], dtype=float) > 0
                loss += (count * kept * unit * np.log1p(own / unit)).sum(axis=1)
            per_pose.append(own)
            columns = np.r_[0:6, start : start + term.n, self.n]
            total[:, columns[:, None], columns] += M
            start += term.n
        return total, loss, per_pose

    def move(self, state: State, step) -> State:
        """The state after a step (B, n)."""
        turned = Rotation.from_rotvec(step[:, 3:6]).as_matrix()
        placements, start = [], 6
        for term, (place, direction) in zip(self.terms, state.placements, strict=True):
            points, turning = term.moving((place, direction))
            q = points.shape[1]
            place = place + np.einsum("bj,bja->ba", step[:, start : start + q], points)
            if term.turns:
                direction = direction + np.einsum("bj,bja->ba", step[:, start + q : start + term.n], turning)
                direction = direction / np.linalg.norm(direction, axis=1, keepdims=True)
            placements.append((place, direction))
            start += term.n
        shift = np.einsum("bij,bj->bi", state.rotation, step[:, :3])
        return State(state.rotation @ turned, state.translation + shift, tuple(placements))

    def place(self, rotation, translation) -> State:
        """Sensor poses (B, 3, 3), (B, 3) with each target placed where they see it."""
        placements = []
        for term in self.terms:
            B, m, P = len(rotation), len(term.seen), term.P
            x, z = (np.swapaxes(term.seen[:, i], 0, 1).reshape(-1, 1, m * P) for i in (0, 1))  # (B|1, 1, mP)
            seen = rotation[:, :, :1] * x + rotation[:, :, 2:] * z + translation[:, :, None]
            seen = seen.reshape(B, 3, m, P) + term.shift[:, :, None]
            base = np.einsum("nabp,nbmp->npma", term.turn.reshape(-1, 3, 3, P), seen)
            if term.present is not None:
                base = _fill(base, np.moveaxis(term.present, 0, 2))
            placements.append(term.module.place(base.reshape(B, -1, 3), term.size))
        return State(rotation, translation, tuple(placements))


def _fill(points, present):
    """Points (B, P, m, 3) with the missing ones put into the middle of the others."""
    present = present[..., None]
    middle = (points * present).sum(axis=(1, 2), keepdims=True) / present.sum(axis=(1, 2), keepdims=True)
    return np.where(present, points, middle)


@dataclass(frozen=True)
class Fit:
    """Where a refinement of B problems ended."""

    state: State
    M: np.ndarray  # (B, n + 1, n + 1) normal equations there
    loss: np.ndarray  # (B,)
    per_pose: list  # (B, P) each pose's χ² per residual, for each target
    converged: np.ndarray  # (B,)
    iterations: int

    @property
    def information(self) -> np.ndarray:
        """(B, n, n), mm and rad."""
        return self.M[:, :-1, :-1]

    @property
    def chi2(self) -> np.ndarray:
        return self.M[:, -1, -1]


def refine(
    problem: Problem,
    state: State,
    *,
    scale=None,
    weights=None,
    in_plane: bool = True,
    iterations: int = 60,
    tolerance: float = 1e-10,
) -> Fit:
    """Damped Gauss-Newton (Levenberg and Marquardt), each of B problems with its own damping.

    Ends where the step is below `tolerance` (rad, and a hundred times that in mm), or promises less than rounding.
    """
    B = len(state.rotation)
    with np.errstate(all="ignore"):
        M, loss, per_pose = problem.moments(state, scale, in_plane, weights)
        damping, done = np.full(B, 1e-4), np.zeros(B, dtype=bool)
        for iteration in range(1, iterations + 1):
            size = np.sqrt(np.einsum("bii->bi", M)[:, :-1])
            size = np.where(size > 0, size, 1.0)
            H = M[:, :-1, :-1] / (size[:, :, None] * size[:, None])
            H = np.where(np.isfinite(H), H, 0.0) + damping[:, None, None] * np.eye(problem.n)
            g = np.nan_to_num(M[:, :-1, -1] / size, posinf=0, neginf=0)
            scaled = -np.linalg.solve(H, g[..., None])[..., 0]
            step = scaled / size
            trial = problem.move(state, step)
            M_t, loss_t, per_pose_t = problem.moments(trial, scale, in_plane, weights)
            small = (np.abs(step[:, 3:6]).max(axis=1) < tolerance) & (np.abs(step[:, :3]).max(axis=1) < 100 * tolerance)
            better = np.isfinite(loss_t) & (loss_t <= loss) & ~done
            flat = -np.einsum("bi,bi->b", g, scaled) <= 1e-15 * loss
            state = State.where(better, trial, state)
            M = np.where(better[:, None, None], M_t, M)
            per_pose = [np.where(better[:, None], a, b) for a, b in zip(per_pose_t, per_pose, strict=True)]
            loss = np.where(better, loss_t, loss)
            done |= small | flat
            damping = np.where(better, np.maximum(damping * 0.05, 1e-12), np.minimum(damping * 20, 1e8))
            if done.all():
                break
    return Fit(state, M, loss, per_pose, done, iteration)
