"""One calibration for every target: the sensor pose and all placements in one maximum-likelihood step.

Unknown are the sensor pose (6) and where each target is (edge 4, disk 5, ball 3, plane 3, point 3). A residual is an
observed point minus where the scan plane meets the target, in the scan plane. Each target file offers `residual` and
its derivatives in the *sensor* frame; everything else is the same for all of them and is written once, here.

The sensor pose is perturbed as T · exp(δ), δ = (ρ, φ) in the sensor's frame: a point at p there moves to
p - ρ + p × φ, a direction d to d + d × φ. Every function takes a batch of problems along the leading axis.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi2 as chi2_law

from profilecal.checks import UnobservableError
from profilecal.observability import POSE_UNITS, Spectrum, explain, of_covariance, spectrum
from profilecal.poses import angle_between, homogeneous
from profilecal.simulate import Noise
from profilecal.targets import ball, disk, edge, plane, point

TARGETS = {"edge": edge, "disk": disk, "ball": ball, "plane": plane, "point": point}
BATCHED = ("R_flange", "T_flange", "points", "covariance")  # the fields of Observations with a batch axis
CAUCHY = 2.385  # noise levels at which a residual's weight is a half: 95 % efficient on clean data (Rey 1983)


def variances(position_mm: float, orientation_deg: float) -> np.ndarray:
    """Of the six components of a flange pose's error, mm² and rad²."""
    return np.repeat([position_mm, np.radians(orientation_deg)], 3) ** 2


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
    # of what was seen from each pose, as a multiple of `Noise.profile_mm`²; None: 1 for each coordinate, independent.
    # edge, disk (..., P, 2m, 2m) of x and z of its points; ball, plane (..., P, m) of their distance from the curve
    covariance: np.ndarray | None = None

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
        if self.covariance is not None:
            if self.kind == "point":
                raise ValueError("a marked point has no covariance of its own; state profile_mm and steering_mm")
            P, m = shape[-3:-1]
            tail, given = (P, m) if self.on_curve else (P, 2 * m, 2 * m), np.shape(self.covariance)
            if given[-len(tail) :] != tail:
                raise ValueError(f"covariance has shape {given}; expected (..., {', '.join(map(str, tail))})")

    def keep(self, poses) -> "Observations":
        """Only some poses, by mask or index."""
        group = None if self.group is None else np.asarray(self.group)[poses]
        covariance = self.covariance
        if covariance is not None:
            covariance = covariance[..., poses, :] if self.on_curve else covariance[..., poses, :, :]
        return replace(
            self,
            R_flange=self.R_flange[..., poses, :, :],
            T_flange=self.T_flange[..., poses, :],
            points=self.points[..., poses, :, :],
            group=group,
            covariance=covariance,
        )

    @property
    def on_curve(self) -> bool:
        """Whether points lie anywhere on a curve, so that only their distance from it says something."""
        return self.kind in ("ball", "plane")


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
    def join(first: "State", second: "State") -> "State":
        """Two batches as one."""
        pairs = zip(first.placements, second.placements, strict=True)
        return State(
            np.concatenate([first.rotation, second.rotation]),
            np.concatenate([first.translation, second.translation]),
            tuple((np.concatenate([p, q]), np.concatenate([d, e])) for (p, d), (q, e) in pairs),
        )

    @staticmethod
    def where(mask, first: "State", second: "State") -> "State":
        """`first` where the mask (B,) holds, `second` elsewhere."""

        def pick(a, b):
            return np.where(mask.reshape(-1, *[1] * (a.ndim - 1)), a, b)

        pairs = zip(first.placements, second.placements, strict=True)
        placements = tuple((pick(p, q), pick(d, e)) for (p, d), (q, e) in pairs)
        return State(pick(first.rotation, second.rotation), pick(first.translation, second.translation), placements)


def across(direction):
    """Two unit vectors (B, 2, 3) perpendicular to unit vectors (B, 3) and to each other."""
    aside = np.eye(3)[np.argmin(np.abs(direction), axis=-1)]
    first = np.stack(_cross(direction.T, aside.T), axis=-1)
    first /= np.sqrt(np.einsum("...i,...i", first, first))[..., None]
    return np.stack([first, np.stack(_cross(direction.T, first.T), axis=-1)], axis=-2)


def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _pairs(covariance, m):
    """Covariances (B, P, 2m, 2m) as (B, P, m, 2, m, 2)."""
    return covariance.reshape(*covariance.shape[:2], m, 2, m, 2)


class Term:
    """One target's observations, arranged for speed: poses along the last axis, a batch axis B (or 1) first."""

    def __init__(self, observations: Observations, noise: Noise):
        self.module = TARGETS[observations.kind]
        self.size = observations.size
        if observations.kind == "point":
            self.size = noise.profile_mm / noise.steering_mm if noise.steering_mm and noise.profile_mm else 1.0
        R, T, points = (
            np.asarray(a, float) for a in (observations.R_flange, observations.T_flange, observations.points)
        )
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
        self.sd = self.whiten = None
        if observations.covariance is not None:
            self.sd, self.whiten = self.precision(np.asarray(observations.covariance, float), observations.on_curve)

    def precision(self, covariance, on_curve: bool):
        """Standard deviations (B|1, m, P) of the points, as multiples of the noise; and for edge and disk the
        triangular matrices (B|1, 2m, 2m, P) that turn their residuals into independent ones of unit variance."""
        m = len(self.seen)
        if on_curve:
            return np.sqrt(np.moveaxis(covariance.reshape(-1, self.P, m), 1, 2)), None
        covariance = covariance.reshape(-1, self.P, 2 * m, 2 * m)
        sd = np.sqrt(np.einsum("bpmimi->bmp", _pairs(covariance, m)) / 2)
        if m == 2:  # the disk's residuals are across and along the chord
            chord = self.seen[1] - self.seen[0]
            x, z = chord / np.maximum(np.hypot(*chord), 1e-300)  # (B, P)
            x = np.where(np.hypot(x, z) > 0, x, 1.0)  # where nothing was seen
            turn = np.moveaxis(np.array([[-z, x], [x, z]]), (0, 1), (2, 3))
            turned = np.einsum("bpij,bpmjnk,bplk->bpminl", turn, _pairs(covariance, m), turn)
            covariance = turned.reshape(covariance.shape)
        return sd, np.moveaxis(np.linalg.inv(np.linalg.cholesky(covariance)), 1, -1)

    def in_units_of_noise(self, z, sigma, in_plane: bool = True):
        """Derivatives and residuals z (B, columns, K, P), changed in place: over the noise sigma (B|1, 1, 1), mm, and
        as precise as each point is."""
        z /= sigma[..., None]
        if self.whiten is not None and in_plane:
            for k in reversed(range(z.shape[2])):
                z[:, :, k] *= self.whiten[:, None, k, k]
                for j in range(k):
                    z[:, :, k] += self.whiten[:, None, k, j] * z[:, :, j]
        elif self.sd is not None:
            z /= np.repeat(self.sd, z.shape[2] // len(self.seen), axis=1)[:, None]
        return z

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
        p, d, *moving = ([local[:, j, i] for i in range(3)] for j in range(local.shape[1]))
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
                z[:, 6 + j, k] = _dot(P, moving[j])
            for j in range(turning.shape[1]):
                z[:, 6 + q + j, k] = _dot(D, moving[q + j])
            z[:, 6 + self.n, k] = r[k]
        if with_robot:
            arm = state.translation[:, :, None] + (self.shift if self.eye_to_hand else 0)
            arm = np.moveaxis(np.swapaxes(state.rotation, 1, 2) @ arm, 1, 0)[
                :, :, None
            ]  # flange to sensor, (3, B, 1, P)
            z[:, -6:-3] = z[:, :3]
            lever = _cross(arm, np.moveaxis(z[:, :3], 1, 0))
            for j in range(3):
                z[:, -3 + j] = z[:, 3 + j] + lever[j]
        present = None
        if self.present is not None:
            present = np.moveaxis(np.repeat(self.present, K // len(self.present), axis=0), 0, 1)
            z *= present[:, None]
        return z, present


def _halving(gram):
    """A (..., 6, 6) with (1 - E A Eᵀ)² = (1 + E Eᵀ)⁻¹, from the Gram matrices EᵀE (..., 6, 6) of errors E."""
    values, vectors = np.linalg.eigh(gram)
    values = np.maximum(values, 1e-300)
    root = np.sqrt(1 + values)
    return (vectors / (root * (1 + root))[..., None, :]) @ np.swapaxes(vectors, -1, -2)


def _remove(z, E, EA):
    """z (B, N, K, P) times (1 - E A Eᵀ), pose by pose; E and E A are (B, 6, K, P)."""
    inner = np.einsum("bekp,bnkp->bnep", E, z)
    return z - np.einsum("bekp,bnep->bnkp", EA, inner)


class Whitening:
    """Robot errors seen through one term's measurements at one state: they enlarge and correlate the residuals.

    With the errors' derivatives E in units of the scanner noise, residuals have the covariance 1 + E Eᵀ; their
    multiplication with its inverse square root is whitening. Poses come first, then rotation groups.
    """

    def __init__(self, errors, of_pose, of_group, group):
        def prepare(variances):
            E = errors * np.sqrt(variances)[:, None, None]
            A = _halving(np.einsum("bekp,bfkp->bpef", E, E))
            return E, np.einsum("bpef,bfkp->bekp", A, E)

        self.pose = prepare(of_pose) if of_pose.any() else None
        self.marginal = prepare(of_pose + of_group)
        self.shared = errors * np.sqrt(of_group)[:, None, None] if of_group.any() else None
        if self.shared is not None and self.pose:
            self.shared = _remove(self.shared, *self.pose)
        self.member = (group[:, None] == np.arange(group.max() + 1)).astype(float)  # (P, G)

    def groups(self, z, root_weight):
        """z (B, N, K, P), whitened pose by pose and weighted, with what the groups share whitened too."""
        E = self.shared * root_weight
        gram = np.swapaxes(np.einsum("bekp,bfkp->befp", E, E) @ self.member, 1, 3)  # (B, G, 6, 6)
        inner = np.einsum("bekp,bnkp->bnep", E, z) @ self.member  # (B, N, 6, G)
        inner = np.einsum("bgef,bnfg->bneg", _halving(gram), inner) @ self.member.T
        return z - np.einsum("bekp,bnep->bnkp", E, inner)


class Problem:
    """All terms with their noise. `noise.profile_mm` must be known here; it may be an array (B,)."""

    def __init__(self, observations: Sequence[Observations], noise: Noise):
        self.terms = [Term(entry, noise) for entry in observations]
        self.sigma = np.asarray(noise.profile_mm, dtype=float).reshape(-1, 1, 1)
        self.of_pose = variances(noise.position_mm, noise.orientation_deg)
        self.of_group = variances(noise.group_position_mm, noise.group_orientation_deg)
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

    def whitening(self, state: State) -> list:
        """What robot errors do to each term's residuals at this state; None where there are none."""
        if not self.has_robot:
            return [None] * len(self.terms)
        pairs = zip(self.terms, state.placements, strict=True)
        errors = [
            term.in_units_of_noise(term.linearise(state, p, True, with_robot=True)[0][:, -6:], self.sigma)
            for term, p in pairs
        ]
        return [
            Whitening(np.nan_to_num(E, posinf=0, neginf=0), self.of_pose, self.of_group, term.group)
            for E, term in zip(errors, self.terms, strict=True)
        ]

    def moments(self, state: State, scale=None, in_plane: bool = True, weights=None, whitening=None):
        """(M, loss, own): normal equations [J r]ᵀ C⁻¹ [J r], (B, n + 1, n + 1), the loss (B,), and each pose's own
        χ² per residual, one (B, P) for each target.

        `scale` (B,): Cauchy's loss with that many noise levels as its unit; None: least squares. `weights`: one
        (B, P) or (P,) for each target. `whitening`: from the state itself if None.
        """
        B = len(state.rotation)
        total, loss, per_pose = np.zeros((B, self.n + 1, self.n + 1)), np.zeros(B), []
        whitening = whitening or self.whitening(state)
        start = 6
        for index, (term, placement) in enumerate(zip(self.terms, state.placements, strict=True)):
            z, present = term.linearise(state, placement, in_plane)
            count = z.shape[2] if present is None else np.maximum(present.sum(axis=1), 1)
            weight = None if weights is None else np.asarray(weights[index], dtype=float)
            z = term.in_units_of_noise(z, self.sigma, in_plane)
            white = whitening[index]
            r = z[:, -1:] if white is None else _remove(z[:, -1:], *white.marginal)
            own = np.einsum("bnkp,bnkp->bp", r, r) / count
            if scale is not None:
                unit = (CAUCHY * scale[:, None]) ** 2
                loss += (count * (1 if weight is None else weight) * unit * np.log1p(own / unit)).sum(axis=1)
                weight = (1 if weight is None else weight) / (1 + own / unit)
            if white is not None and white.pose:
                z = _remove(z, *white.pose)
            root_weight = 1.0
            if weight is not None:
                root_weight = np.sqrt(np.broadcast_to(weight, own.shape))[:, None, None]
                z *= root_weight
            if white is not None and white.shared is not None:
                z = white.groups(z, root_weight)
            flat = z.reshape(B, z.shape[1], -1)
            M = flat @ np.swapaxes(flat, 1, 2)
            if scale is None:
                loss += M[:, -1, -1]
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
    damping: float = 1e-4,
) -> Fit:
    """The state of least loss nearest to each of B states: `descend`, with the whitening of robot errors held fixed
    meanwhile and then brought up to date, until that moves nothing."""
    how = (scale, weights, in_plane, iterations, tolerance, damping)
    if not problem.has_robot:
        return descend(problem, state, None, *how)
    for _ in range(8):
        fit = descend(problem, state, problem.whitening(state), *how)
        moved = pose_error(state.rotation, state.translation, fit.state.rotation, fit.state.translation)
        state = fit.state
        if np.abs(moved / np.r_[100, 100, 100, 1, 1, 1]).max() < 1e3 * tolerance:
            break
    return fit


def descend(problem, state, whitening, scale, weights, in_plane, iterations, tolerance, damping) -> Fit:
    """Damped Gauss-Newton (Levenberg and Marquardt), each of B problems with its own damping.

    Ends where the step is below `tolerance` (rad, and a hundred times that in mm), or promises less than rounding.
    """
    B = len(state.rotation)
    with np.errstate(all="ignore"):
        M, loss, per_pose = problem.moments(state, scale, in_plane, weights, whitening)
        damping, done = np.full(B, damping), np.zeros(B, dtype=bool)
        for _ in range(iterations):
            size = np.sqrt(np.einsum("bii->bi", M)[:, :-1])
            size = np.where(size > 0, size, 1.0)
            H = M[:, :-1, :-1] / (size[:, :, None] * size[:, None])
            H = np.where(np.isfinite(H), H, 0.0) + damping[:, None, None] * np.eye(problem.n)
            g = np.nan_to_num(M[:, :-1, -1] / size, posinf=0, neginf=0)
            scaled = -np.linalg.solve(H, g[..., None])[..., 0]
            step = scaled / size
            trial = problem.move(state, step)
            M_t, loss_t, per_pose_t = problem.moments(trial, scale, in_plane, weights, whitening)
            small = (np.abs(step[:, 3:6]).max(axis=1) < tolerance) & (np.abs(step[:, :3]).max(axis=1) < 100 * tolerance)
            flat = -np.einsum("bi,bi->b", g, scaled) <= 1e-15 * loss
            better = np.isfinite(loss_t) & (loss_t <= loss) & ~done
            state = State.where(better, trial, state)
            M = np.where(better[:, None, None], M_t, M)
            per_pose = [np.where(better[:, None], a, b) for a, b in zip(per_pose_t, per_pose, strict=True)]
            loss = np.where(better, loss_t, loss)
            done |= small | flat
            damping = np.where(better, np.maximum(damping * 0.05, 1e-12), np.minimum(damping * 20, 1e8))
            if done.all():
                break
    return Fit(state, M, loss, per_pose, done)


# --- one data set, from start to statement ---

GRID = "I"  # scipy's name for the 60 rotations of the icosahedron: any rotation is within 45° of one of them
SEARCH_POSES, SEARCH_POINTS = 40, 5  # the search looks at that many poses, and points in each
SEARCH_ROUNDS = ((12, 30), (20, 12))  # steps, and how many starts go on after them
KEPT = 6  # starts that all poses are looked at from
SUBSET = 24  # poses that one start looks at where some are bad: few enough to be lucky
FALSE_ALARM = 0.01  # the chance that any good pose at all is rejected


@dataclass(frozen=True)
class Solution:
    """One calibration with its evidence."""

    rotation: np.ndarray  # (3, 3) sensor axes in the flange frame (eye-to-hand: in the base frame)
    translation: np.ndarray  # (3,) mm
    covariance: np.ndarray  # (6, 6) of (ρ, φ) in the sensor's frame, mm and rad: T = T̂ · exp(δ)
    placements: tuple  # a target object (Edge, Disk, …) for each set of observations
    noise_mm: float
    noise_source: str  # "given" or "estimated"
    noise_how: str  # in words
    chi2: float
    dof: int
    rms_mm: float  # of the residuals kept
    normalised: tuple  # (P,) for each target: each pose's residual over its expected size
    rejected: tuple  # (P,) bool for each target
    status: str  # "ok", "weak" or "unobservable"
    observability: Spectrum
    messages: tuple  # sentences a person can act on
    converged: bool
    noise: Noise  # all of it, as it was used

    @property
    def chi2_per_dof(self) -> float:
        return self.chi2 / self.dof

    @property
    def state(self) -> State:
        """The sensor pose and the targets, a batch of one."""
        pairs = [(np.asarray(v, dtype=float) for v in vars(target).values()) for target in self.placements]
        placements = ((p[None], (rest[0] if rest and rest[0].ndim else np.zeros(3))[None]) for p, *rest in pairs)
        return State(self.rotation[None], self.translation[None], tuple(placements))

    @property
    def kept(self) -> list[np.ndarray]:
        """The poses (P,) of each target that were not rejected."""
        return [~bad for bad in self.rejected]

    @property
    def T_flange_sensor(self) -> np.ndarray:
        return homogeneous(self.rotation, self.translation)

    @property
    def translation_sd_mm(self) -> np.ndarray:
        return np.sqrt(np.diag(self.covariance)[:3])

    @property
    def rotation_sd_deg(self) -> np.ndarray:
        return np.degrees(np.sqrt(np.diag(self.covariance)[3:]))

    @property
    def covariance_mm_deg(self) -> np.ndarray:
        """The covariance with the rotation vector in degrees."""
        units = np.r_[1, 1, 1, np.full(3, 180 / np.pi)]
        return self.covariance * units[:, None] * units


def pose_error(rotation, translation, true_rotation, true_translation) -> np.ndarray:
    """δ (..., 6), mm and rad, sensor frame, with T_true = T · exp(δ) to first order: what the covariance is of."""
    turn = np.swapaxes(rotation, -1, -2) @ true_rotation
    shift = np.swapaxes(rotation, -1, -2) @ (true_translation - translation)[..., None]
    angles = Rotation.from_matrix(turn.reshape(-1, 3, 3)).as_rotvec().reshape(*turn.shape[:-2], 3)
    return np.concatenate([shift[..., 0], angles], axis=-1)


def difference(first: Solution, second: Solution) -> tuple[np.ndarray, np.ndarray]:
    """δ (6,) from one sensor pose to another, mm and rad, the first one's frame, and its covariance (6, 6) if their
    errors are independent."""
    delta = pose_error(first.rotation, first.translation, second.rotation, second.translation)
    turn = np.kron(np.eye(2), first.rotation.T @ second.rotation)
    return delta, first.covariance + turn @ second.covariance @ turn.T


def units_by_hand(problem: Problem) -> np.ndarray:
    """What one would know of each parameter (n,) by hand: `observability.POSE_UNITS`, and the same for placements."""
    mm, rad = POSE_UNITS[0], POSE_UNITS[3]
    return np.concatenate([POSE_UNITS, *([mm] * (t.n - 2 * t.turns) + [rad] * (2 * t.turns) for t in problem.terms)])


def affine_noise(observations: Observations) -> tuple[float, int]:
    """Scanner noise from an edge or a marked point before anything is calibrated, mm, and its degrees of freedom.

    Inside a rotation group the sensed point is an affine function of the flange position, whatever the calibration:
    what is left of a regression is noise. The median over the groups keeps a bad point from counting.
    """
    points, group = np.asarray(observations.points)[0, :, 0], np.asarray(observations.group)
    root_weight = np.ones((len(points), 1))
    if observations.covariance is not None:
        root_weight = 1 / np.sqrt(np.trace(observations.covariance[0], axis1=1, axis2=2) / 2)[:, None]
    variances, freedoms = [], []
    for label in np.unique(group):
        rows = (group == label) & np.isfinite(points).all(axis=1)
        T, w = observations.T_flange[0, rows], root_weight[rows]
        if len(T) < 3:
            continue
        T, y = (w * (v - np.average(v, axis=0, weights=w[:, 0] ** 2)) for v in (T, points[rows]))
        U, s, _ = np.linalg.svd(T, full_matrices=False)
        U = U[:, s > 1e-3 * s.max()]
        freedom = len(T) - 1 - U.shape[1]
        if freedom > 0:
            variances.append(np.sum((y - U @ (U.T @ y)) ** 2) / chi2_law.median(2 * freedom))
            freedoms.append(2 * freedom)
    return (float(np.sqrt(np.median(variances))), sum(freedoms)) if variances else (0.0, 0)


def search(observations: Sequence[Observations], noise: Noise, starts=()) -> State:
    """Sensor poses worth refining, best first, at most KEPT: from `starts`, pairs (R (3, 3), T (3,) mm), and from a
    grid of rotations, each with the targets placed where it sees them, by distances in space and on a few poses."""
    problem = Problem([_thin(entry, SEARCH_POSES) for entry in observations], Noise(noise.profile_mm))
    rotation, translation = Rotation.create_group(GRID).as_matrix(), np.zeros((60, 3))
    if len(starts):
        rotation = np.concatenate([[R for R, _ in starts], rotation])
        translation = np.concatenate([[T for _, T in starts], translation])
    state = problem.place(rotation, translation)
    for steps, kept in SEARCH_ROUNDS:
        found = refine(problem, state, in_plane=False, iterations=steps)
        state = found.state[np.argsort(np.where(np.isfinite(found.loss), found.loss, np.inf))[:kept]]
    return state[_distinct(state, range(len(state.rotation)))[:KEPT]]


def search_among_outliers(observations: Sequence[Observations], noise: Noise, found: State) -> State:
    """`search` for data of which a part is wrong, in addition to what it `found`: each rotation of the grid looks at
    another few groups of poses, some of which hold no bad one, and the medians of all residuals tell which."""
    rotation = Rotation.create_group(GRID).as_matrix()
    subsets = Problem([_subsets(entry, len(rotation)) for entry in observations], Noise(noise.profile_mm))
    tried = refine(subsets, subsets.place(rotation, np.zeros((60, 3))), in_plane=False, iterations=25).state
    problem = Problem([_thin(entry, 2 * SEARCH_POSES) for entry in observations], Noise(noise.profile_mm))
    count = [_per_pose(term) for term in problem.terms]
    tried = tried[np.isfinite(problem.moments(tried, in_plane=False)[1])]
    state = State.join(found, tried)
    own = problem.moments(state, in_plane=False)[2]
    state = state[np.argsort(_spread(own, count))[: 4 * KEPT]]
    for _ in range(3):
        scale = np.maximum(_spread(problem.moments(state, in_plane=False)[2], count), 1e-9)
        state = refine(problem, state, scale=scale, in_plane=False, iterations=8).state
    order = np.argsort(_spread(problem.moments(state, in_plane=False)[2], count))
    return state[_distinct(state, order)[:KEPT]]


def _thin(observations: Observations, count: int) -> Observations:
    """About `count` poses, and SEARCH_POINTS points in each where profiles are used."""
    P, m = observations.points.shape[-3:-1]
    step = max(1, m // SEARCH_POINTS) if observations.kind in ("ball", "plane") else 1
    few = observations.keep(np.unique(np.linspace(0, P - 1, min(P, count)).round().astype(int)))
    if step == 1:
        return few
    covariance = None if few.covariance is None else few.covariance[..., step // 2 :: step]
    return replace(few, points=few.points[..., step // 2 :: step, :], covariance=covariance)


def _subsets(observations: Observations, count: int) -> Observations:
    """A batch of `count` different selections of about SUBSET poses, each from few groups."""
    P = observations.points.shape[-3]
    group = np.arange(P) if observations.group is None else np.unique(observations.group, return_inverse=True)[1]
    groups = group.max() + 1
    each = max(3, -(-SUBSET // groups), SUBSET // 5 if groups < P else 1)
    batch = []
    for k in range(count):
        shuffled = np.argsort((np.arange(1, groups + 1) * (k + 1) * (np.sqrt(5) - 1) / 2) % 1, kind="stable")
        members = [np.flatnonzero(group == g) for g in shuffled]
        picked = [m[np.unique(np.linspace(0, len(m) - 1, min(each, len(m))).astype(int))] for m in members]
        batch.append(np.concatenate(picked)[: min(SUBSET, P)])
    short = min(map(len, batch))
    thin = [_thin(observations.keep(chosen[:short]), short) for chosen in batch]
    names = BATCHED if observations.covariance is not None else BATCHED[:-1]
    return replace(thin[0], **{name: np.concatenate([getattr(t, name) for t in thin]) for name in names}, group=None)


def _distinct(state: State, order, turn: float = 0.02, shift: float = 2.0) -> list[int]:
    """Indices in the given order without those that repeat an earlier pose (within 1° and 2 mm)."""
    kept: list[int] = []
    for i in order:
        same = (angle_between(state.rotation[kept], state.rotation[i]) < turn) & (
            np.linalg.norm(state.translation[kept] - state.translation[i], axis=-1) < shift
        )
        if not same.any():
            kept.append(int(i))
    return kept


def _spread(own, count) -> np.ndarray:
    """How many noise levels large the residuals of most poses are, (B,), from medians: bad poses do not count."""
    level = [np.median(o * (k / chi2_law.median(k)), axis=1) for o, k in zip(own, count, strict=True)]
    return np.sqrt(np.mean(level, axis=0))


def _bad_poses(problem: Problem, own, count, scale: float) -> list[np.ndarray]:
    """Poses (P,) of each term whose residuals are beyond chance, and groups of which more than half are."""
    total, rejected = sum(len(o) for o in own), []
    for term, o, k in zip(problem.terms, own, count, strict=True):
        bad = o * k > scale**2 * chi2_law.isf(FALSE_ALARM / total, k)
        size = np.bincount(term.group)
        crowd = (np.bincount(term.group, bad) > size / 2) & (size > 2)
        rejected.append(bad | crowd[term.group])
    return rejected


def solve(
    observations: Sequence[Observations],
    noise: Noise | None = None,
    *,
    starts=(),
    robust: bool = True,
    searching: bool = True,
) -> Solution:
    """The sensor pose from all observations together, with its covariance and what it can be believed.

    `noise.profile_mm` 0: not known, to be estimated.
    `starts`: poses (R (3, 3), T (3,) mm) to start from besides the grid: closed forms, a mount measured by hand.
    `robust=False` is plain least squares throughout: nothing is rejected. `searching=False` trusts `starts` alone, as
    where only the noise has changed since a solution.

    Raises ValueError for malformed input and UnobservableError for fewer residuals than unknowns.
    """
    observations, noise = list(observations), noise or Noise()
    if not observations:
        raise ValueError("no observations given; expected at least one target")
    noise, source, how = _first_noise(observations, noise)
    problem = Problem(observations, noise)
    total = int(problem.count()[0])
    if total <= problem.n:
        raise UnobservableError(f"{total} measured coordinates cannot determine {problem.n} unknowns; add poses")

    if searching:
        found = search(observations, noise, starts)
    else:
        found = problem.place(np.stack([R for R, _ in starts]), np.stack([T for _, T in starts]))
    fit = refine(problem, found)
    count = [_per_pose(term) for term in problem.terms]
    weights, scale = None, 1.0
    if robust:
        least = 0.0 if source == "residuals" else 1.0
        fit, scale = _robust(problem, fit.state, count, least)
        bad = _bad_poses(problem, [o[0] for o in fit.per_pose], count, least or scale)
        if searching and any(b.any() for b in bad):
            fit, scale = _robust(problem, search_among_outliers(observations, noise, fit.state), count, least)
        weights = [~bad for bad in _bad_poses(problem, [o[0] for o in fit.per_pose], count, scale)]
        for _ in range(5):
            if sum(int((w * k).sum()) for w, k in zip(weights, count, strict=True)) <= problem.n:
                raise UnobservableError("most poses contradict each other: no sensor pose explains half of them")
            fit = refine(problem, fit.state, weights=weights)
            if source == "residuals":
                scale = float(_spread(fit.per_pose, count)[np.argmin(fit.loss)])
            best = int(np.argmin(fit.loss))
            before, weights = weights, [~b for b in _bad_poses(problem, [o[best] for o in fit.per_pose], count, scale)]
            if all((a == b).all() for a, b in zip(before, weights, strict=True)):
                break
        weights = before
    best = int(np.argmin(fit.loss))
    kept = total if weights is None else sum(int((w * k).sum()) for w, k in zip(weights, count, strict=True))
    dof = kept - problem.n
    one = fit.state[[best]]
    if source == "residuals":
        for _ in range(20):
            factor = np.sqrt(float(refine(problem, one, weights=weights).chi2[0]) / dof)
            noise = replace(noise, profile_mm=max(noise.profile_mm * factor, 1e-12))
            problem = Problem(observations, noise)
            if abs(factor - 1) < 1e-6:
                break
    everything = fit.state
    fit = refine(problem, one, weights=weights)
    return _state_result(problem, observations, noise, source, how, fit, everything, weights, dof)


def _per_pose(term: Term) -> np.ndarray:
    """How many residuals each pose has, (P,)."""
    rows = {"edge": 2, "disk": 4, "point": 3}.get(term.module.__name__.rsplit(".", 1)[1], len(term.seen))
    if term.present is None:
        return np.full(term.P, rows)
    return np.maximum(term.present[:, 0].sum(axis=0) * (rows // len(term.seen)), 1)


def _first_noise(observations, noise: Noise) -> tuple[Noise, str, str]:
    """The scanner noise to begin with: given, from rotation groups, or 1 mm until the residuals tell."""
    if noise.profile_mm:
        if not noise.profile_mm > 0:
            raise ValueError(f"profile_mm is {noise.profile_mm}; expected a standard deviation, 0 if unknown")
        return noise, "given", "as given"
    found = [affine_noise(o) for o in observations if o.kind in ("edge", "point") and o.group is not None]
    freedom = sum(f for _, f in found)
    if freedom >= 10:
        level = np.sqrt(sum(f * s**2 for s, f in found) / freedom)
        return (
            replace(noise, profile_mm=max(float(level), 1e-12)),
            "groups",
            (f"from the scatter inside rotation groups, {freedom} degrees of freedom"),
        )
    return replace(noise, profile_mm=1.0), "residuals", "from the residuals"


def _robust(problem: Problem, state: State, count, least: float) -> tuple[Fit, float]:
    """Cauchy's loss, its unit lowered from what the residuals look like to what the noise is: the fits, best first,
    and that unit."""

    def unit(per_pose):
        return np.maximum(_spread(per_pose, count), max(least, 1e-9))

    per_pose = problem.moments(state)[2]
    for _ in range(4):
        fit = refine(problem, state, scale=unit(per_pose), iterations=10)
        best = np.argsort(unit(fit.per_pose), kind="stable")[:3]
        state, per_pose = fit.state[best], [own[best] for own in fit.per_pose]
    fit = refine(problem, state, scale=np.full(len(best), unit(per_pose).min()))
    order = np.argsort(fit.loss)
    per_pose = [own[order] for own in fit.per_pose]
    fit = Fit(fit.state[order], fit.M[order], fit.loss[order], per_pose, fit.converged[order])
    return fit, float(unit(per_pose)[0])


def _state_result(problem, observations, noise, source, how, fit, everything, weights, dof) -> Solution:
    """The solution object, with what there is to say."""
    state, chi2 = fit.state, float(fit.chi2[0])
    found = spectrum(fit.information[0], units_by_hand(problem))
    messages, status = [], str(found.status)
    factor = chi2 / dof
    unlikely = chi2_law.isf(1e-3, dof) / dof
    covariance = found.covariance
    if source != "residuals" and factor > unlikely:
        covariance = found.covariance * factor
        found = of_covariance(covariance, found.rank, found.parameters)
        status = str(found.status)
        than = {
            "groups": "the scatter inside rotation groups, so groups differ by more than scanner noise (robot errors?)",
            "given": "what the stated noise explains",
        }[source]
        messages.append(f"residuals are {factor**0.5:.2g} times {than}; the covariance is enlarged to match")
    messages += explain(
        found,
        state.rotation[0],
        np.concatenate([np.asarray(o.R_flange).reshape(-1, 3, 3) for o in observations]),
        "base" if observations[0].eye_to_hand else "flange",
    )

    if status != "unobservable":
        other = refine(problem, everything, weights=weights)
        delta = pose_error(state.rotation, state.translation, other.state.rotation, other.state.translation)
        apart = np.einsum("bi,ij,bj->b", delta, np.linalg.inv(covariance), delta)
        twin = np.flatnonzero((apart > 50) & (other.loss < fit.loss[0] + 12))
        if twin.size:
            status = "weak"
            R, T = other.state.rotation[twin[0]], other.state.translation[twin[0]]
            messages.append(
                "another sensor pose explains the data as well, "
                f"{np.degrees(angle_between(R, state.rotation[0])):.3g}° and "
                f"{np.linalg.norm(T - state.translation[0]):.3g} mm away; add poses from other directions"
            )
    residuals = [
        term.linearise(state, p, True)[0][0, -1] for term, p in zip(problem.terms, state.placements, strict=True)
    ]
    weights = weights or [np.ones(term.P, dtype=bool) for term in problem.terms]
    square = sum(float((r**2 * w).sum()) for r, w in zip(residuals, weights, strict=True))
    return Solution(
        state.rotation[0],
        state.translation[0],
        covariance,
        tuple(target_at(o, p[0], d[0]) for o, (p, d) in zip(observations, state.placements, strict=True)),
        float(noise.profile_mm),
        "given" if source == "given" else "estimated",
        how,
        chi2,
        dof,
        float(np.sqrt(square / (dof + problem.n))),
        tuple(np.sqrt(o[0]) for o in fit.per_pose),
        tuple(~w for w in weights),
        status,
        found,
        tuple(messages),
        bool(fit.converged[0]),
        noise,
    )


def target_at(observations: Observations, place, direction):
    """The target object of a placement."""
    if observations.kind == "disk":
        return disk.Disk(place, direction, observations.size)
    if observations.kind == "ball":
        return ball.Ball(place, observations.size)
    if observations.kind == "point":
        return point.Point(place)
    return {"edge": edge.Edge, "plane": plane.Plane}[observations.kind](place, direction)


def take(observations: Observations, chosen) -> Observations:
    """Some problems of a batch of observations, by mask, index or slice."""
    given = {name: getattr(observations, name) for name in BATCHED}
    batch = {name: np.asarray(value) for name, value in given.items() if value is not None}
    length = max(map(len, batch.values()))
    return replace(observations, **{k: v[chosen] if len(v) == length else v for k, v in batch.items()})


def normalised_square(covariance, error) -> np.ndarray:
    """Errors (..., 6) squared over their covariances (..., 6, 6): follows χ² with 6 degrees of freedom if honest."""
    return np.einsum("...i,...i", error, np.linalg.solve(covariance, error[..., None])[..., 0])


def estimate(
    observations: Sequence[Observations], noise: Noise, start: State, *, chunk: int = 64, steps: int = 60
) -> tuple[State, Spectrum, np.ndarray]:
    """For noise studies: batches of problems refined from known starts by least squares, chunk by chunk.

    Returns the states (B), the sensor poses' spectra and χ² (B,).
    """
    states, spectra, chi2 = [], [], []
    for first in range(0, len(start.rotation), chunk):
        part = slice(first, first + chunk)
        problem = Problem([take(o, part) for o in observations], noise)
        fit = refine(problem, start[part], iterations=steps, tolerance=1e-8, damping=1e-9)
        states.append(fit.state)
        spectra.append(spectrum(fit.information, units_by_hand(problem)))
        chi2.append(fit.chi2)
    state = states[0]
    for other in states[1:]:
        state = State.join(state, other)
    fields = ("covariance", "sd", "directions", "rank")
    together = Spectrum(*(np.concatenate([getattr(s, f) for s in spectra]) for f in fields), spectra[0].parameters)
    return state, together, np.concatenate(chi2)
