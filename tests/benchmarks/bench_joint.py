"""The joint calibration against scipy's least_squares, and from files to result; the
edge method's closed form.
"""

import tempfile
from pathlib import Path

import numpy as np
from bench import at_most, least
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import profilecal as pc
from profilecal.calibration.observe import observe_all
from profilecal.calibration.plausibility import systematic_tests
from profilecal.geometry.noise import Noise
from profilecal.joint.prior import prior_from
from profilecal.joint.problem import Problem
from profilecal.joint.solve import solve
from profilecal.simulation.scene import random_scene
from profilecal.targets.state import State
from profilecal_papers.monte_carlo import estimate

SIGMA = 0.05  # mm
TRIALS = 320
PEER = "scipy least_squares(method='lm')"


def scipy_solution(problem: Problem, start: State) -> np.ndarray:
    """The parameters' change from `start`, (n,), by MINPACK with our analytic
    derivatives: one problem at a time.
    """
    sigma = problem.noise.profile_mm
    last = {}  # residuals and derivatives, where they were asked for last

    def at(x):
        if last.get("x") != x.tobytes():
            state = problem.move(start, x[None])
            z = problem.terms[0].linearise(state, state.placements[0])[0]
            last.update(x=x.tobytes(), z=z.reshape(len(z), -1) / sigma)
        return last["z"]

    # the derivatives are by a step from where one is, as ours, which differ from those
    # by x at second order only
    fit = least_squares(
        lambda x: at(x)[-1],
        np.zeros(problem.n),
        jac=lambda x: at(x)[:-1].T,
        method="lm",
    )
    return fit.x


def scan_row(name: str, kind: str, measured: str, most: float) -> dict:
    """From what a scan of 60 poses shows to an answer with its tests: no guess, all
    errors estimated, what does not belong left out.

    The other starts 5 mm and 3° off, with the target where that sees it, and knows the
    scanner's noise alone.

    Aimed at are 10 times as long for edge points, 6 for ball arcs, 4 for profiles. Of
    the 25 ms for edge points, of which the other takes 2.3, half goes to the errors'
    sizes: Newton's method to the likeliest, and 48 sets of sizes to average over, those
    of a robot whose errors are smooth alone among them. The search without a guess
    takes a sixth, from 12 rotations at once; a ball's search has 60. The linear models
    with their derivatives, and the tests, take a quarter. For 60 poses nearly all of it
    is what calls of NumPy cost, some 14,500 calls of functions in all.
    """
    plan = {"groups": 12, "positions": 5, "measured": measured}
    scan, truth = pc.simulate(kind, seed=3, **plan)
    _, observed, features_mm = observe_all((scan,))
    prior = prior_from({} if features_mm else {"profile_mm": SIGMA}, features_mm)
    rng = np.random.default_rng(0)
    shift, turn = (axis / np.linalg.norm(axis) for axis in rng.normal(size=(2, 3)))
    R_off = Rotation.from_rotvec(np.radians(3) * turn).as_matrix()
    R = truth.pose[:3, :3] @ R_off
    T = truth.pose[:3, 3] + 5 * shift

    def plain():
        problem = Problem(observed, Noise(SIGMA))
        return scipy_solution(problem, problem.place(R[None], T[None]))

    ours, theirs = least(
        lambda: systematic_tests(solve(observed, prior), {}), plain, repeats=7
    )
    reference = f"{PEER} from 5 mm and 3° off, with our derivatives; no robot errors"
    name = f"joint: one scan of 60 poses, {name}"
    return at_most(most, name, ours, reference, theirs)


def disk_row() -> dict:
    """Many problems at once, as the studies of the papers solve them."""
    rng = np.random.default_rng(1)
    scene = random_scene("disk", rng, positions=100)
    seen, noise = scene.noisy(SIGMA, rng, TRIALS), Noise(SIGMA)
    off = np.r_[np.full(3, 1.0), np.full(3, 0.01), np.zeros(5)]
    truths = scene.truth[[0] * TRIALS]
    start = Problem([seen], noise).move(truths, np.tile(off, (TRIALS, 1)))
    few = [(Problem([seen.take([k])], noise), start[[k]]) for k in range(16)]
    ours, theirs = least(
        lambda: estimate([seen], noise, start),
        lambda: [scipy_solution(*one) for one in few],
        repeats=3,
    )
    name = f"joint: disk, 11 parameters, 1600 residuals, in batches of {TRIALS}"
    reference = f"{PEER}, one problem at a time, with our derivatives"
    return at_most(0.25, name, ours / TRIALS, reference, theirs / len(few))


def files_row() -> dict:
    """A scan folder, read and calibrated."""
    scan, _ = pc.simulate("edge", seed=2, groups=25, positions=10)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "scan"
        pc.write_scan(scan, folder)
        (ours,) = least(lambda: pc.calibrate(pc.read_scan(folder)), repeats=3)
    name = "joint: 25 x 10 edge points, from files to result"
    return at_most(1, name, ours, "one second beyond interpreter and imports", 1.0)


def edge_row() -> dict:
    """The closed form of 25 rotations x 10 translations."""
    scan, _ = pc.simulate("edge", seed=13, groups=25, positions=10)
    R, T = scan.R_base_flange, scan.p_base_flange
    points = np.concatenate(scan.values)
    (ours,) = least(lambda: pc.solve_edge(R, T, points), repeats=50)
    return at_most(1, "edge: closed form, 25 x 10", ours, "5 ms", 5e-3)


def rows() -> list[dict]:
    return [
        edge_row(),
        disk_row(),
        files_row(),
        scan_row("edge points", "edge", "points", 12),
        scan_row("ball arcs", "ball", "arcs", 14),
        scan_row("ball profiles", "ball", "profiles", 6),
        scan_row("plane profiles", "plane", "profiles", 5),
    ]
