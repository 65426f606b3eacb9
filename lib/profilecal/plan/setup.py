"""What is known before a scan, and what poses will be worth: the information that their profiles will hold."""

from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace

import numpy as np

from profilecal.calibrate.observe import three_points
from profilecal.geometry.noise import ROBOT, Noise, Systematic
from profilecal.geometry.poses import carry, rotation_groups, rotations
from profilecal.joint.linear_model import LinearModel, marginal
from profilecal.joint.observability import Spectrum, name_direction, size_direction, spectrum, units_by_hand
from profilecal.joint.observations import Observations
from profilecal.joint.perturbations import considered
from profilecal.joint.problem import Problem
from profilecal.joint.state import State
from profilecal.simulate.guess import Margins
from profilecal.simulate.scanner import Scanner
from profilecal.simulate.scene import in_unit_ball
from profilecal.targets.target import Target

FILLED = 0.9  # of the field of view, by a face
GUESSES = 20  # draws of what may be true
COUNT = 40  # points of a curve that a feature of a raw profile has


@dataclass(frozen=True)
class Setup:
    """A sensor, a target and a robot, as they are believed to be. The frames are those of the joint solution: eye-to-
    hand, "flange" is the base and "base" the flange."""

    target: Target  # where it stands, mm
    facing: np.ndarray  # (3, 3) a sensor frame that looks at it squarely
    R_sensor: np.ndarray  # (3, 3) on the flange
    T_sensor: np.ndarray  # (3,) mm
    scanner: Scanner
    noise: Noise  # the variances that predictions count with
    systematic: Systematic = Systematic()  # noqa: RUF009
    to_hand: bool = False
    measured: str = "profiles"
    covariance: np.ndarray | None = None  # of what a pose shows, over the noise's profile_mm², as `Observations` has it
    margins: Margins = Margins()  # noqa: RUF009
    count: int = COUNT  # points of a curve that a pose gives

    @property
    def sizes(self) -> tuple[float, ...]:
        """The target's lengths, mm."""
        return tuple(getattr(self.target, name) for name in self.target.lengths)

    @property
    def state(self) -> State:
        """The unknowns, a batch of one."""
        placed = tuple(part[None] for part in self.target.frame)
        return State(self.R_sensor[None], self.T_sensor[None], (placed,))

    def planes(self, R, T) -> tuple[np.ndarray, np.ndarray]:
        """Sensor frames (P, 3, 3), (P, 3) at flange poses."""
        return R @ self.R_sensor, carry(R, T, self.T_sensor)

    @property
    def shows_beside(self) -> bool:
        """Whether raw profiles show the target by what is around it."""
        return self.measured == "profiles" and self.target.beside_mm > 0

    @property
    def fills_view(self) -> bool:
        """Whether the target is a face, which moves only if it is shifted along one axis."""
        return len(self.target.shifts) == 1

    def seen(self, target: Target, planes, count: int) -> np.ndarray:
        """What a perfect scanner sees of a target, (P, m, 2): `Target.points_seen`; of a face, all across the view."""
        points = target.points_seen(*planes, count)
        if not self.fills_view:
            return points
        (x, z), (dx, dz) = points[:, 0].T, (points[:, -1] - points[:, 0]).T
        slope, wide = dz / dx, FILLED * self.scanner.half_width(np.array([0.0, 1.0]))
        growth, middle = wide[1] - wide[0], z - x * slope
        left, right = (side * (wide[0] + growth * middle) / (1 - side * growth * slope) for side in (-1, 1))
        across = left[:, None] + (right - left)[:, None] * np.linspace(0, 1, count)
        return np.stack([across, middle[:, None] + across * slope[:, None]], axis=-1)

    def shown(self, target: Target, planes) -> np.ndarray:
        """What of it a pose gives, (P, m, 2): its points, or of an arc three that stand for it."""
        if self.measured == "arcs":
            return three_points(target.meet(*planes))
        return self.seen(target, planes, self.count)

    def observed(self, R, T) -> Observations:
        """What the scanner will see of the target from flange poses (P, 3, 3), (P, 3), mm; NaN where it misses it."""
        points, covariance = self.shown(self.target, self.planes(R, T)), self.covariance
        if covariance is not None:
            covariance = np.broadcast_to(covariance, (1, len(R), *covariance.shape))
        group = rotation_groups(R)
        return Observations(
            self.target.kind, R[None], T[None], points[None], self.sizes, group, self.to_hand, covariance
        )


@dataclass(frozen=True)
class Prediction:
    """How well poses will determine the sensor pose."""

    spectrum: Spectrum
    setup: Setup
    poses: int
    spare: int  # measured coordinates beyond the unknowns
    between: tuple[tuple[float, float], ...] = ()  # `mm` and `deg`, smallest and largest, if the guess is wrong

    @property
    def covariance(self) -> np.ndarray:
        """(6, 6) of δ = (ρ, φ) in the sensor's frame, mm and rad: as `calibrate` will state it."""
        return self.spectrum.covariance

    @property
    def mm(self) -> float:
        """The largest standard deviation of the translation in any direction."""
        return float(np.sqrt(np.linalg.eigvalsh(self.covariance[:3, :3])[-1]))

    @property
    def deg(self) -> float:
        """The largest standard deviation of the rotation about any axis."""
        return float(np.degrees(np.sqrt(np.linalg.eigvalsh(self.covariance[3:, 3:])[-1])))

    @property
    def weakest(self) -> str:
        """The weakest direction in words, with its standard deviation."""
        frame = "base" if self.setup.to_hand else "flange"
        sd, direction = self.spectrum.sd[0], self.spectrum.directions[0]
        name = name_direction(direction, self.setup.R_sensor, frame)
        return f"{name}, {size_direction(sd, direction)}" if sd < 10 else f"{name}, open"


Part = tuple[Setup, np.ndarray, np.ndarray]  # one target's setup, flange poses (P, 3, 3), (P, 3), mm


def problem_of(parts: Sequence[Part]) -> tuple[Problem, State]:
    """The least-squares problem of targets seen from flange poses, by one sensor on one robot, and its state."""
    first, state = parts[0][0], parts[0][0].state
    observations, placements = [], []
    for setup, R, T in parts:
        seen, ratio = setup.observed(R, T), (setup.noise.profile_mm / first.noise.profile_mm) ** 2
        if ratio != 1:
            P, m = seen.points.shape[1:3]
            unit = np.ones((1, P, m)) if seen.on_curve else np.broadcast_to(np.eye(2 * m), (1, P, 2 * m, 2 * m))
            seen = replace(seen, covariance=ratio * (unit if seen.covariance is None else seen.covariance))
        observations.append(seen)
        placements += setup.state.placements
    return Problem(observations, first.noise, first.systematic), replace(state, placements=tuple(placements))


def model_of(parts: Sequence[Part]) -> tuple[LinearModel, np.ndarray]:
    """The linear model of what targets seen from flange poses will show, and the variances (1 + k,) of all errors."""
    problem, state = problem_of([part for part in parts if len(part[2])])
    names = [name for name in ROBOT if getattr(problem.noise, name)]
    return problem.model(state, names), np.array([1.0, *(getattr(problem.noise, name) ** 2 for name in names)])


def unknowns(parts: Sequence[Part]) -> tuple[list[np.ndarray], np.ndarray, int]:
    """Which of all unknowns those of each target are that has poses, and those of what is wrong at all of these poses;
    how many unknowns there are. The sensor pose's are the first six."""
    ends = np.cumsum([6, *(len(setup.target.shifts) + len(setup.target.turns) for setup, _, _ in parts)])
    seen = [k for k, (_, _, T) in enumerate(parts) if len(T)]
    common = len(scales([parts[k] for k in seen])[1])  # no radius, if no target has one
    targets = [np.arange(ends[k], ends[k + 1]) for k in seen]
    return targets, ends[-1] + np.arange(common), int(ends[-1]) + len(scales(parts)[1])


def blocks(parts: Sequence[Part]) -> np.ndarray:
    """What each pose adds, (poses, q, q): its information on the q `unknowns`, the pose's own robot error integrated
    out. True of poses that all have orientations of their own."""
    targets, common, size = unknowns(parts)
    model, v = model_of(parts)
    columns, whole = np.concatenate([np.arange(6), *targets, common]), np.zeros((len(model.counts), size, size))
    whole[:, columns[:, None], columns] = model.alone(v)[:, :-1, :-1]
    return whole


def information(parts: Sequence[Part]) -> np.ndarray:
    """The same of all poses together, (q, q), whichever orientations they share."""
    targets, common, size = unknowns(parts)
    model, v = model_of(parts)
    columns, whole = np.concatenate([np.arange(6), *targets, common]), np.zeros((size, size))
    whole[columns[:, None], columns] = model.posterior(v[None]).normal[0, :-1, :-1]
    return whole


def scales(parts: Sequence[Part]) -> tuple[np.ndarray, np.ndarray]:
    """Of the unknowns (n,): what is known by hand, mm and rad; of what is wrong at every pose (c,): how large it is."""
    targets = [setup.target for setup, _, _ in parts]
    return units_by_hand(targets), np.array([size for _, size in considered(targets, parts[0][0].systematic)])


def predict(parts: Sequence[Part], rng: np.random.Generator | None = None) -> Prediction:
    """How well flange poses will determine the sensor pose, from any targets. With `rng`: and how well if the guess is
    wrong by anything within its margins."""
    parts = [part for part in parts if len(part[2])]
    known, (problem, _) = scales(parts), problem_of(parts)
    spectrum_of = spectrum(
        marginal(information(parts) + np.diag(np.r_[np.zeros(problem.n), known[1] ** -2.0]), problem.n), known[0]
    )
    poses, spare = sum(len(T) for _, _, T in parts), int(problem.count()[0]) - problem.n
    found = Prediction(spectrum_of, parts[0][0], poses, spare)
    if rng is None or not any(astuple(parts[0][0].margins)):
        return found
    others = [predict(displaced(parts, rng)) for _ in range(GUESSES)]
    values = [[other.mm for other in others], [other.deg for other in others]]
    return replace(found, between=tuple((min(some), max(some)) for some in values))


def displaced(parts: Sequence[Part], rng: np.random.Generator) -> list[Part]:
    """The same poses where sensor and targets are off the guess by anything within its margins."""
    found, (first, _, _) = [], parts[0]
    shift, turn = in_unit_ball(rng, 2)
    R_sensor = first.R_sensor @ rotations(np.radians(first.margins.mount_deg) * turn)
    T_sensor = first.T_sensor + first.margins.mount_mm * shift
    for setup, R, T in parts:
        moved, turned = in_unit_ball(rng, 2)
        (origin, axes), back = setup.target.frame, rotations(np.radians(setup.margins.target_deg) * turned)
        target = setup.target.at(origin + setup.margins.target_mm * moved, back @ axes, setup.sizes)
        there = replace(setup, R_sensor=R_sensor, T_sensor=T_sensor, target=target, facing=back @ setup.facing)
        found.append((there, R, T))
    return found
