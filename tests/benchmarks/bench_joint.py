"""The joint calibration against scipy's least_squares, and from files to result."""

import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from profilecal.geometry.noise import Noise
from profilecal.joint.descent import estimate
from profilecal.joint.observations import Observations
from profilecal.joint.problem import Problem
from profilecal.joint.solve import solve
from profilecal.joint.state import State
from profilecal.simulate.scene import random_scene

SIGMA, TRIALS, AGREEMENT = 0.05, 320, 1e-8


def best_of(count: int, run) -> float:
    """Least CPU time in seconds of `count` runs."""
    times = []
    for _ in range(count):
        start = time.process_time()
        run()
        times.append(time.process_time() - start)
    return min(times)


def scipy_solution(problem: Problem, start: State) -> np.ndarray:
    """The parameters' change from `start`, (n,), by MINPACK with our analytic derivatives: one problem at a time."""
    last = {}

    def at(x):
        if last.get("x") != x.tobytes():
            state = problem.move(start, x[None])
            z = problem.terms[0].linearise(state, state.placements[0]).columns[0]
            last.update(x=x.tobytes(), z=z.reshape(len(z), -1) / SIGMA)
        return last["z"]

    # the derivatives are by a step from where one is, as ours, which differ from those by x at second order only
    found = least_squares(lambda x: at(x)[-1], np.zeros(problem.n), jac=lambda x: at(x)[:-1].T, method="lm")
    return found.x


def disk_row() -> dict:
    rng = np.random.default_rng(1)
    scene = random_scene("disk", rng, positions=100)
    seen, noise = scene.noisy(SIGMA, rng, TRIALS), Noise(SIGMA)
    start = scene.truth.repeat(TRIALS)
    start = Problem([seen], noise).move(
        start, np.r_[np.full(3, 1.0), np.full(3, 0.01), np.zeros(5)][None].repeat(TRIALS, 0)
    )
    ours = best_of(3, lambda: estimate([seen], noise, start, chunk=32)) / TRIALS
    few = [(Problem([seen.take([k])], noise), start[[k]]) for k in range(16)]
    theirs = best_of(3, lambda: [scipy_solution(*one) for one in few]) / len(few)

    state = estimate([seen], noise, start)[0]
    apart = []
    for k, (problem, first) in enumerate(few):
        other = problem.move(first, scipy_solution(problem, first)[None])
        apart.append(np.abs(other.rotation[0] - state.rotation[k]).max())
        apart.append(np.abs(other.translation[0] - state.translation[k]).max() / 100)
    ratio = theirs / ours
    return {
        "name": f"joint: disk, 11 parameters, 1600 residuals, agreeing to {max(apart):.1g}",
        "ours_s": ours,
        "reference": "scipy least_squares(method='lm'), analytic Jacobian",
        "reference_s": theirs,
        "ratio": ratio,
        "target": f"4 x faster, agreeing to {AGREEMENT:g}",
        "met": bool(ratio >= 4 and max(apart) < AGREEMENT),
    }


def files_row() -> dict:
    rng = np.random.default_rng(2)
    seen = random_scene("edge", rng).noisy(SIGMA, rng)
    q = Rotation.from_matrix(seen.R_flange[0]).as_quat()
    poses = pd.DataFrame(np.column_stack([seen.T_flange[0], q]), columns=["x", "y", "z", "qx", "qy", "qz", "qw"])
    points = pd.DataFrame(seen.points[0, :, 0], columns=["x", "z"])

    def run(folder):
        p = pd.read_csv(folder / "poses.csv")
        R = Rotation.from_quat(p[["qx", "qy", "qz", "qw"]].to_numpy()).as_matrix()
        xz = pd.read_csv(folder / "points.csv")[["x", "z"]].to_numpy()
        return solve(
            [Observations("edge", R[None], p[["x", "y", "z"]].to_numpy()[None], xz[None, :, None], group=p["group"])]
        )

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        poses.assign(group=seen.group).to_csv(folder / "poses.csv", index=False)
        points.to_csv(folder / "points.csv", index=False)
        ours = best_of(3, lambda: run(folder))
    return {
        "name": "joint: 25 x 10 edge points, from files to result",
        "ours_s": ours,
        "reference": "one second",
        "reference_s": 1.0,
        "ratio": 1 / ours,
        "target": "under 1 s beyond interpreter and imports",
        "met": ours < 1,
    }


def rows() -> list[dict]:
    return [disk_row(), files_row()]
