"""Sweeps: the robot moves, its controller logs poses, and the scanner takes profiles by
a clock of its own.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from numpy import ndarray
from numpy.random import Generator

from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import Frames, inverse, rotations
from profilecal.scan.motion import DELAY_MS, checked_log
from profilecal.scan.toml import Count, number, one_of
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
    """One way across a target, at times from its middle. Poses are of the sensor."""

    middle: ndarray  # (3,) of the sensor's way, mm
    facing: ndarray  # (3, 3) its axes there
    along: ndarray  # (3,) the direction of motion
    speed: float  # signed
    half: float  # mm to either side
    # (3,) the direction of the slow drift of a weave
    aside: Sequence | ndarray = (0.0, 0.0, 0.0)
    phase: float = 0.0  # of the weave and the turn, rad
    turn: Sequence | ndarray = (0.0, 0.0, 0.0)  # (3,) rad
    weaves: bool = False

    @property
    def seconds(self) -> float:
        """How long it takes."""
        if self.weaves:  # one and a half times to and fro
            return 3 * np.pi * self.half / abs(self.speed)
        return 2 * self.half / abs(self.speed)

    def at(self, t: ndarray) -> Frames:
        """Sensor frames (n, 3, 3), (n, 3) at times (n,) s."""
        share = (t / self.seconds)[:, None]
        if self.weaves:
            angle = self.speed / self.half * t + self.phase
            way = self.half * np.sin(angle)[:, None] * self.along
            way = way + 2 * DRIFTING_MM * share * self.aside
        else:
            way = self.speed * t[:, None] * self.along
        turned = rotations(np.sin(2 * np.pi * share + self.phase) * self.turn)
        return turned @ self.facing, self.middle + way

    def behind(self, t: ndarray, lag_s: float) -> Frames:
        """The same of a controller that follows its log with a lag of the first order:
        at each time an average over earlier ones, exponentially weighted.
        """
        earlier, weights = np.polynomial.laguerre.laggauss(5)
        late = [self.at(t - lag_s * one) for one in earlier]
        R, _ = self.at(t - lag_s)
        return R, np.tensordot(weights, [p for _, p in late], 1)


def half_way(setup: Setup) -> ndarray:
    """From the middle of a way across a target to its end, (3,) mm along the sensor's
    axes.
    """
    target = setup.target
    half = target.across_mm or target.across_part * setup.sizes[0]
    return half * np.array(target.across) / np.linalg.norm(target.across)


def sweeps_of(
    setup: Setup, motion: Motion, spread_deg: float, rng: Generator
) -> list[Sweep]:
    """The sweeps of a motion, from an orientation each; both ways, two from each."""
    across = half_way(setup)
    half = float(np.linalg.norm(across))
    across = across / half
    middle, _ = setup.target.frame
    both = motion.pattern == "both ways"
    sweeps: list[Sweep] = []
    for k in range(motion.sweeps):
        if both and k % 2:
            sweeps.append(replace(sweeps[-1], speed=-motion.speed))
            continue
        tilt = rotations(np.radians(spread_deg) * in_unit_ball(rng, 1)[0])
        facing = tilt @ setup.facing
        along, speed = facing @ across, motion.speed
        if motion.pattern == "one way in the base":
            along = setup.facing @ across
        if motion.pattern == "random":
            speed = speed * rng.uniform(0.5, 2) * rng.choice([-1, 1])
            along = along + 0.5 * in_unit_ball(rng, 1)[0]
            along = along / np.linalg.norm(along)
        aim = middle + facing @ (10 * rng.uniform(-1, 1, 3) * [1, 0, 1])
        sweeps.append(
            Sweep(
                middle=aim - STANDOFF * facing[:, 2],
                facing=facing,
                along=along,
                aside=facing @ [0.3, 1.0, 0.2],
                speed=speed,
                half=half,
                phase=rng.uniform(0, 2 * np.pi),
                turn=np.radians(motion.turn_deg) * in_unit_ball(rng, 1)[0],
                weaves=motion.pattern == "weave",
            )
        )
    return sweeps


def drive(
    setup: Setup,
    motion: Motion,
    noise: Noise,
    rng: Generator,
    *,
    spread_deg: float,
    to_hand: bool = False,
    planned: Sequence[Sweep] = (),
) -> tuple[dict[str, Any], Frames]:
    """What a robot and a scanner record on the sweeps of a motion, or on those that are
    planned, with the errors of the robot that a sweep or a stop has, and the jitter of
    the scanner's times: entries of a Scan; and where the flange really was, (P, 3, 3),
    (P, 3). All poses are of the flange in the base.
    """

    def flange(R: ndarray, p: ndarray) -> Frames:
        """Poses (n, 3, 3), (n, 3) that take the scanner to sensor frames."""
        pose = setup.flange(R, p)
        return inverse(*pose) if to_hand else pose

    still = replace(motion, pattern="random", sweeps=motion.stops)
    places = sweeps_of(setup, still, spread_deg, rng)
    stops = []
    for place in places:  # not in the middle, where a ball's side is open
        share = rng.uniform(0.1, 0.4, 1) * rng.choice([-1, 1])
        stops.append(flange(*place.at(share * place.seconds)))
    actual = [erring(*stop, noise, rng) for stop in stops]
    logs, times, names = [], [np.full(motion.stops, np.nan)], [""] * motion.stops
    begin = 1.0
    sweeps = planned or sweeps_of(setup, motion, spread_deg, rng)
    for k, sweep in enumerate(sweeps):
        middle = begin + sweep.seconds / 2
        ends = begin - BESIDE_S, begin + sweep.seconds + BESIDE_S
        t = np.arange(*ends, 1 / motion.log_hz).round(6)
        logs.append((t, *flange(*sweep.at(t - middle))))
        shares = (np.arange(motion.profiles) + 0.5) / motion.profiles
        taken = begin + shares * sweep.seconds
        taken = taken[rng.uniform(0, 100, len(taken)) >= motion.dropped_percent]
        way = flange(*sweep.behind(taken - middle, motion.lag_ms / 1000))
        actual.append(erring(*way, noise, rng))
        jitter = noise.jitter_ms / 1000 * rng.normal(size=len(taken))
        times.append(taken - motion.delay_ms / 1000 + jitter)
        names += [f"s{k + 1}"] * len(taken)
        begin = ends[1] + PAUSE_S
    t, R_log, p_log = (np.concatenate(parts) for parts in zip(*logs, strict=True))
    clock = np.concatenate(times)
    clock = clock - 1e-6 * motion.drift_ppm * (clock - t.mean())
    poses = {
        "labels": [f"p{k + 1}" for k in range(motion.stops)],
        "R_base_flange": np.reshape([R for R, _ in stops], (-1, 3, 3)),
        "p_base_flange": np.reshape([p for _, p in stops], (-1, 3)),
        "group": np.arange(motion.stops),
        "log": checked_log(t, R_log, p_log),
        "times": clock.round(6),
        "sweeps": tuple(names),
    }
    R, p = (np.concatenate(parts) for parts in zip(*actual, strict=True))
    return poses, (R, p)


def erring(R: ndarray, p: ndarray, noise: Noise, rng: Generator) -> Frames:
    """Poses with the errors that all share, and those of each."""
    shape = p.shape
    shift = noise.group_position_mm * rng.normal(size=3)
    shift = shift + noise.position_mm * rng.normal(size=shape)
    turn = noise.group_orientation_deg * rng.normal(size=3)
    turn = turn + noise.orientation_deg * rng.normal(size=shape)
    return rotations(np.radians(turn)) @ R, p + shift
