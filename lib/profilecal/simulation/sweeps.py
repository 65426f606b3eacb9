"""Sweeps: the robot moves, its controller logs poses, and the scanner takes profiles by
a clock of its own.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from numpy import ndarray
from numpy.random import Generator

from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import Frames, inverse, rotations, unit
from profilecal.scan.scan import DELAY_MS, checked_log
from profilecal.scan.toml import Count, Entries, number, one_of
from profilecal.simulation.robot import actual_poses, revisited
from profilecal.simulation.scene import STANDOFF, Setup, in_unit_ball

PATTERNS = ("weave", "both ways", "random", "one way", "one way in the base")
# s between sweeps, and that the log goes on before and after each
PAUSE_S, BESIDE_S = 5.0, 0.5
DRIFTING_MM = 5.0  # to either side, across the weave


@dataclass(frozen=True)
class Motion:
    """How a scan is driven; the entries that a specification's [motion] table has."""

    pattern: Annotated[str, one_of(PATTERNS)] = "weave"
    sweeps: Count = 24
    profiles: Count = 60  # in each
    speed: Annotated[float, number(1, 2000)] = 100.0  # mm/s
    turn_deg: float = 0.0  # by which the flange turns to and fro in a sweep
    stops: int = 0  # poses at rest besides
    log_hz: Annotated[float, number(2, 1000)] = 100.0
    # the robot's clock less the scanner's
    delay_ms: Annotated[float, DELAY_MS] = 30.0
    # by which the scanner's clock is too slow
    drift_ppm: Annotated[float, number(-1000, 1000)] = 0.0
    lag_ms: float = 0.0  # by which the flange is behind the log
    dropped_percent: Annotated[float, number(0, 90)] = 0.0  # of the profiles


@dataclass(frozen=True)
class Sweep:
    """One way across a target."""

    seconds: float
    # the sensor's frames (n, 3, 3), (n, 3) mm at times (n,) s from the middle
    at: Callable[[ndarray], Frames]

    def back(self, t: ndarray) -> Frames:
        """The same on the way back."""
        return self.at(-t)

    def behind(self, t: ndarray, lag_s: float) -> Frames:
        """The same of a controller that follows its log with a lag of the first order:
        at each time an average over earlier positions, exponentially weighted, and the
        orientation at their mean time.
        """
        earlier, weights = np.polynomial.laguerre.laggauss(5)
        late = [self.at(t - lag_s * one)[1] for one in earlier]
        return self.at(t - lag_s)[0], np.tensordot(weights, late, 1)


def half_way(setup: Setup) -> ndarray:
    """From the middle of a way across a target to its end, (3,) mm along the sensor's
    axes.
    """
    target = setup.target
    return target.across_mm * unit(np.array(target.across))


def random_sweep(
    setup: Setup, motion: Motion, spread_deg: float, rng: Generator
) -> Sweep:
    """A sweep of a motion from any orientation and about the middle of the target."""
    across = half_way(setup)
    half = float(np.linalg.norm(across))
    across = across / half
    tilt = rotations(np.radians(spread_deg) * in_unit_ball(rng, 1)[0])
    R_view = tilt @ setup.facing
    along, speed = R_view @ across, motion.speed
    if motion.pattern == "one way in the base":
        along = setup.facing @ across
    if motion.pattern == "random":
        speed = speed * rng.uniform(0.5, 2) * rng.choice([-1, 1])
        along = unit(along + 0.5 * in_unit_ball(rng, 1)[0])
    aim = setup.target.frame[0] + R_view @ (10 * rng.uniform(-1, 1, 3) * [1, 0, 1])
    middle = aim - STANDOFF * R_view[:, 2]
    phase = rng.uniform(0, 2 * np.pi)
    turn = np.radians(motion.turn_deg) * in_unit_ball(rng, 1)[0]
    weaves = motion.pattern == "weave"  # one and a half times to and fro
    seconds = (3 * np.pi if weaves else 2) * half / abs(speed)

    def at(t: ndarray) -> Frames:
        share = (t / seconds)[:, None]
        way = speed * t[:, None] * along
        if weaves:
            way = half * np.sin(speed / half * t + phase)[:, None] * along
            way = way + 2 * DRIFTING_MM * share * (R_view @ [0.3, 1.0, 0.2])
        turned = rotations(np.sin(2 * np.pi * share + phase) * turn)
        return turned @ R_view, middle + way

    return Sweep(seconds, at)


def sweeps_of(
    setup: Setup, motion: Motion, spread_deg: float, rng: Generator
) -> list[Sweep]:
    """The sweeps of a motion; both ways, two on each."""
    sweeps: list[Sweep] = []
    while len(sweeps) < motion.sweeps:
        there = random_sweep(setup, motion, spread_deg, rng)
        sweeps.append(there)
        if motion.pattern == "both ways":
            sweeps.append(Sweep(there.seconds, there.back))
    return sweeps[: motion.sweeps]


def straight(setup: Setup, R: ndarray, T: ndarray, speed: float) -> list[Sweep]:
    """Sweeps at a speed, mm/s, between flange poses (2 n, 3, 3), (2 n, 3), two of each,
    of a sensor that is where `setup` has it.
    """

    def line(R_view: ndarray, begin: ndarray, end: ndarray) -> Sweep:
        seconds = float(np.linalg.norm(end - begin)) / speed

        def at(t: ndarray) -> Frames:
            share = 0.5 + t[:, None] / seconds
            same = np.broadcast_to(R_view, (len(t), 3, 3))
            return same, begin + share * (end - begin)

        return Sweep(seconds, at)

    R_views, T_views = setup.planes(R, T)
    return [*map(line, R_views[::2], T_views[::2], T_views[1::2])]


def drive(
    setup: Setup,
    motion: Motion,
    noise: Noise,
    rng: Generator,
    *,
    sweeps: Sequence[Sweep],
    stops: Sequence[Frames] = (),
    to_hand: bool = False,
) -> tuple[Entries, Frames]:
    """What a robot and a scanner record at stops, sensor frames (1, 3, 3), (1, 3), and
    on sweeps, each with its own error of a group: entries of a Scan; and where the
    flange really was, (P, 3, 3), (P, 3). All poses are of the flange in the base.
    """

    def flange(R_view: ndarray, T_view: ndarray) -> Frames:
        """Poses (n, 3, 3), (n, 3) that take the scanner to sensor frames."""
        pose = setup.flange(R_view, T_view)
        return inverse(*pose) if to_hand else pose

    still = [flange(*view) for view in stops]
    driven, log, times, begin = [*still], [], [], 1.0
    for sweep in sweeps:
        middle = begin + sweep.seconds / 2
        t, taken = moments(sweep, begin, motion, rng)
        log.append((t, *flange(*sweep.at(t - middle))))
        driven.append(flange(*sweep.behind(taken - middle, motion.lag_ms / 1000)))
        jitter = noise.jitter_ms / 1000 * rng.normal(size=len(taken))
        times.append(taken - motion.delay_ms / 1000 + jitter)
        begin = begin + sweep.seconds + BESIDE_S + PAUSE_S
    R, p = map(np.concatenate, zip(*driven, strict=True))
    group = np.repeat(np.arange(len(driven)), [len(part) for part, _ in driven])
    R, p = actual_poses(R, p[:, None], noise, rng, group)
    actual = revisited(R[:, 0], p[:, 0], noise, rng)
    return said_of(still, log, times, motion.drift_ppm), actual


def moments(
    sweep: Sweep, begin: float, motion: Motion, rng: Generator
) -> tuple[ndarray, ndarray]:
    """When the robot notes its pose (m,), s, and when the scanner takes profiles (n,),
    s, by the robot's clock, on a sweep that begins at a time, s.
    """
    end = begin + sweep.seconds
    t = np.arange(begin - BESIDE_S, end + BESIDE_S, 1 / motion.log_hz).round(6)
    shares = (np.arange(motion.profiles) + 0.5) / motion.profiles
    taken = begin + shares * sweep.seconds
    return t, taken[rng.uniform(0, 100, len(taken)) >= motion.dropped_percent]


def said_of(
    stops: list[Frames],
    log: list[tuple[ndarray, ndarray, ndarray]],
    times: list[ndarray],
    drift_ppm: float,
) -> Entries:
    """The entries of a Scan, from the poses at stops, each (1, 3, 3), (1, 3), and of
    each sweep the rows of the log and the times of profiles by the scanner's clock.
    """
    whole = checked_log(*map(np.concatenate, zip(*log, strict=True)))
    still = len(stops)
    clock = np.concatenate([np.full(still, np.nan), *times])
    clock = clock - 1e-6 * drift_ppm * (clock - whole.t.mean())
    names = [[f"s{k + 1}"] * len(taken) for k, taken in enumerate(times)]
    return {
        "labels": [f"p{k + 1}" for k in range(still)],
        "R_base_flange": np.reshape([R for R, _ in stops], (-1, 3, 3)),
        "p_base_flange": np.reshape([p for _, p in stops], (-1, 3)),
        "group": np.arange(still),
        "log": whole,
        "times": clock.round(6),
        "sweeps": tuple(sum(names, [""] * still)),
    }


def resting(
    setup: Setup, motion: Motion, spread_deg: float, rng: Generator
) -> list[Frames]:
    """The sensor's frames, each (1, 3, 3), (1, 3), at the stops of a motion: not in the
    middle, where a ball's side is open.
    """
    still = replace(motion, pattern="random", sweeps=motion.stops)
    places = []
    for sweep in sweeps_of(setup, still, spread_deg, rng):
        share = rng.uniform(0.1, 0.4, 1) * rng.choice([-1, 1])
        places.append(sweep.at(share * sweep.seconds))
    return places
