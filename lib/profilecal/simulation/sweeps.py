"""Sweeps: the robot moves, its controller logs poses, and the scanner takes profiles by
a clock of its own.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
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
# mm to either side, across the weave
DRIFTING = np.array([1.5, 5.0, 1.0])


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
    lag_ms: Annotated[float, number(0, 100)] = 0.0  # of the flange behind the log
    dropped_percent: Annotated[float, number(0, 90)] = 0.0  # of the profiles


@dataclass(frozen=True)
class Sweep:
    """One way across a target, as the sensor goes: straight, weaving about that in one
    and a half waves, and turning to and fro in one.
    """

    seconds: float
    R: ndarray  # (3, 3) the sensor's orientation before it turns
    middle: ndarray  # (3,) mm
    half: ndarray  # (3,) mm, straight from the middle to the end
    weave: ndarray | float = 0.0  # (3,) mm, farthest to a side
    turn: ndarray | tuple = (0.0, 0.0, 0.0)  # (3,) rad, farthest to a side
    phase: float = 0.0  # rad, of both in the middle

    def at(self, t: ndarray) -> Frames:
        """The sensor's frames (n, 3, 3), (n, 3) mm at times (n,) s from the middle."""
        share = t / self.seconds
        waves = np.sin(self.phase + 3 * np.pi * share)
        swings = np.sin(self.phase + 2 * np.pi * share)
        T = self.middle + np.outer(2 * share, self.half) + np.outer(waves, self.weave)
        return rotations(np.outer(swings, self.turn)) @ self.R, T

    def behind(self, t: ndarray, lag_s: float) -> Frames:
        """The same of a controller that follows its log with a lag of the first order:
        at each time an average over earlier positions, exponentially weighted, and the
        orientation at their mean time.

        With the lag L it is ∫ p(t - L s) exp(-s) ds over s > 0, which Gauss-Laguerre
        quadrature takes as a sum.
        """
        lags, weights = np.polynomial.laguerre.laggauss(5)
        earlier = [self.at(t - lag_s * lag)[1] for lag in lags]
        return self.at(t - lag_s)[0], np.tensordot(weights, earlier, 1)


def half_way(setup: Setup) -> ndarray:
    """From the middle of a way across a target to its end, (3,) mm along the sensor's
    axes.
    """
    return setup.target.across_mm * unit(np.array(setup.target.across))


def straight(setup: Setup, R: ndarray, T: ndarray, speed: float) -> list[Sweep]:
    """Sweeps at a speed, mm/s, between flange poses (2 n, 3, 3), (2 n, 3), two of each,
    of a sensor that is where `setup` has it.
    """
    R_view, T_view = setup.planes(R, T)
    begin, end = T_view[::2], T_view[1::2]
    half = (end - begin) / 2
    seconds = 2 * np.linalg.norm(half, axis=1) / speed
    return [*map(Sweep, seconds, R_view[::2], begin + half, half)]


def random_sweeps(
    setup: Setup, motion: Motion, spread_deg: float, rng: Generator
) -> list[Sweep]:
    """The sweeps of a motion, from any orientation and about the middle of the target;
    both ways, two on each.
    """
    pattern, across_mm = motion.pattern, setup.target.across_mm
    sweeps: list[Sweep] = []
    while len(sweeps) < motion.sweeps:
        first = np.radians(spread_deg) * in_unit_ball(rng, 1)
        R = rotations(first)[0] @ setup.facing
        moving = setup.facing if pattern == "one way in the base" else R
        half, weave = moving @ half_way(setup), 0.0
        seconds = 2 * across_mm / motion.speed
        if pattern == "random":
            seconds /= rng.uniform(0.5, 2)
            side = rng.choice([-1, 1])
            aside = across_mm / 2 * in_unit_ball(rng, 1)[0]
            half = side * across_mm * unit(half + aside)
        if pattern == "weave":
            half, weave = R @ DRIFTING, half
            seconds *= 3 * np.pi / 2  # for about that speed at most
        aim = rng.uniform(-1, 1, 3) * [10, 0, 10] - [0, 0, STANDOFF]
        middle = setup.target.frame[0] + R @ aim
        phase = rng.uniform(0, 2 * np.pi)
        turn = np.radians(motion.turn_deg) * in_unit_ball(rng, 1)[0]
        sweeps.append(Sweep(seconds, R, middle, half, weave, turn, phase))
        if pattern == "both ways":
            sweeps.append(Sweep(seconds, R, middle, -half, weave, -turn, -phase))
    return sweeps[: motion.sweeps]


def legs(
    sweeps: Sequence[Sweep], motion: Motion, noise: Noise, rng: Generator
) -> Iterator[tuple[ndarray, Frames, ndarray, Frames]]:
    """Of sweeps one after another the times (L,), s, of the log's rows and the sensor's
    frames in it; the times (n,), s, of the profiles by the scanner's clock and where
    the sensor really was.
    """
    begin, count = 2 * BESIDE_S, motion.profiles
    share = (np.arange(count) + 0.5) / count
    for sweep in sweeps:
        end, middle = begin + sweep.seconds, begin + sweep.seconds / 2
        noted = np.arange(begin - BESIDE_S, end + BESIDE_S, 1 / motion.log_hz).round(6)
        kept = rng.uniform(0, 100, count) >= motion.dropped_percent
        taken = begin + sweep.seconds * share[kept]
        seen = sweep.behind(taken - middle, motion.lag_ms / 1000)
        jitter_ms = noise.jitter_ms * rng.normal(size=len(taken))
        by_scanner = taken + (jitter_ms - motion.delay_ms) / 1000
        yield noted, sweep.at(noted - middle), by_scanner, seen
        begin = end + PAUSE_S + BESIDE_S


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
    rows, logged, times, seen = zip(*legs(sweeps, motion, noise, rng), strict=True)
    # all together, the stops before the sweeps and the log behind them
    t, still, views = np.concatenate(rows), len(stops), [*stops, *seen]
    group = np.arange(len(views)).repeat([len(T) for _, T in views])
    every = zip(*views, *logged, strict=True)
    R, T = setup.flange(*map(np.concatenate, every))
    if to_hand:
        R, T = inverse(R, T)
    by_scanner = np.concatenate([[np.nan] * still, *times])
    by_scanner -= motion.drift_ppm / 1e6 * (by_scanner - t.mean())
    P = len(group)
    said = {
        "labels": [f"p{k + 1}" for k in range(still)],
        "R_base_flange": R[:still],
        "p_base_flange": T[:still],
        "log": checked_log(t, R[P:], T[P:]),
        "times": by_scanner.round(6),
        "sweeps": [f"s{k + 1}" if k >= 0 else "" for k in group - still],
    }
    R, T = actual_poses(R[:P], T[:P, None], noise, rng, group)
    return said, revisited(R[:, 0], T[:, 0], noise, rng)
