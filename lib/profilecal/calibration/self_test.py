"""Can a stated uncertainty be believed here? Scans with the same poses and targets are
simulated from the answer, with errors as large as it found them, and solved again.

To first order a simulated scan has its points where errors of scanner and target (x),
errors u of the flange, as profiles share them, and noise e move them from where the
answer has the targets: along their residuals

    r = A x + E u + e

Two things are asked. Does the region of each solution hold the pose that its scan was
simulated with? Regions are made to hold at 99 % (`error_sizes.growth`), so more than 95
of 100 lie in those of 95 %. And is what the residuals of the real scan look like, by
every pattern that is tested (`plausibility`), what chance makes of such scans? By these
each pattern, over its standard deviation, is a standard normal number.
"""

from dataclasses import dataclass, replace
from numbers import Integral

import numpy as np
from numpy import ndarray
from numpy.random import Generator
from scipy.special import bdtr

from profilecal.calibration.calibration import Calibration
from profilecal.calibration.plausibility import systematic_tests
from profilecal.geometry.checks import check_type
from profilecal.geometry.noise import (
    FALSE_ALARM,
    Noise,
    by_unit,
    chi2_limit,
    normalised_square,
)
from profilecal.geometry.poses import difference, rotations
from profilecal.geometry.progress import watched
from profilecal.joint.prior import Mount, Prior
from profilecal.joint.problem import FLANGE, Problem
from profilecal.joint.solution import Solution
from profilecal.joint.solve import solve
from profilecal.targets.observations import Observations

FEWEST = 10


@dataclass(frozen=True, eq=False, repr=False)
class SelfTest:
    """What scans say of an answer from which they were simulated.

    `holds` and `as_expected` are the verdicts, `sentence` says them.
    """

    squares: ndarray  # (N,) errors of their solutions over their covariances, squared
    # of what the residuals look like, in words: the chance that another such scan looks
    # so more clearly
    chances: dict[str, float]

    @property
    def inside(self) -> int:
        """How many solutions have the truth in their 95 % region."""
        return int(np.sum(self.squares < chi2_limit(0.05, 6)))

    @property
    def holds(self) -> bool:
        """Whether these are no fewer than chance makes of 95 %."""
        return bool(bdtr(self.inside, len(self.squares), 0.95) > FALSE_ALARM)

    @property
    def strange(self) -> list[str]:
        """What the residuals look like that chance does not explain, clearest first."""
        limit = FALSE_ALARM / len(self.chances)
        by_chance = sorted(self.chances, key=lambda words: self.chances[words])
        return [words for words in by_chance if self.chances[words] < limit]

    @property
    def as_expected(self) -> bool:
        """Whether the stated uncertainty can be believed here, as far as this shows."""
        return self.holds and not self.strange

    @property
    def sentence(self) -> str:
        """All that in a sentence."""
        count = len(self.squares)
        counted = (
            f"of {count} scans simulated from this answer {self.inside} have the truth "
            f"in their 95 % region, and the residuals "
        )
        if self.strange:
            looks = ", or as if ".join(self.strange[:3])
            return (
                f"{counted}do not look like theirs, but as if {looks}: do not rely on "
                "the stated uncertainty before that is explained"
            )
        if not self.holds:
            return f"{counted}look like theirs: the stated uncertainty is too small"
        return (
            f"{counted}look like theirs: the stated uncertainty can be believed, but "
            "for errors that no residual shows; another target would show those "
            "(profilecal verify)"
        )

    def __repr__(self) -> str:
        count = len(self.squares)
        return f"SelfTest({self.inside} of {count} inside, strange={self.strange})"


def self_test(found: Calibration, count: int = 100, seed: int = 1) -> SelfTest:
    """Whether the stated uncertainty can be believed here.

    Scans with the same poses and targets are simulated from the answer, with errors as
    large as it found them, and solved again: as many as should have the truth in their
    region, and do the real residuals look like theirs? Errors that are not simulated
    show only if the residuals do.

    Parameters
    ----------
    found : Calibration
        One that has an answer.
    count : int
        How many scans, 10 or more.
    seed : int
        The same seed gives the same scans.

    Returns
    -------
    SelfTest
        `as_expected` is the verdict, `sentence` says it.

    Raises
    ------
    UnobservableError
        For a calibration without an answer.
    ValueError
        For a count that is no whole number, or less than 10.

    See Also
    --------
    verify : compares with another scan, which shows what no residual does.

    Examples
    --------
    >>> import profilecal as pc
    >>> found = pc.calibrate(pc.simulate("plane", seed=1)[0])
    >>> pc.self_test(found, count=10).as_expected
    True
    """
    check_type("found", found, Calibration)
    if not isinstance(count, Integral) or count < FEWEST:
        raise ValueError(
            f"count is {count!r}; expected a whole number, {FEWEST} or more"
        )
    solution = found.known_solution
    rng = np.random.default_rng(seed)
    columns = solution.problem.columns_in_mm(solution.state)
    squares = []
    for _ in watched(range(count), "simulating scans"):
        observed = simulated(solution, columns, rng)
        again = solve(observed, guessed_anew(solution, rng), robust=False)
        error = difference(again.pose, solution.pose)
        squares.append(normalised_square(again.covariance, error))
    tests, _ = systematic_tests(solution, {})
    return SelfTest(np.array(squares), {one.words: one.chance for one in tests})


def simulated(
    solution: Solution, columns: list[ndarray], rng: Generator
) -> list[Observations]:
    """One scan of each target as errors make it that are as large as the solution has
    them, with the poses that it kept. `columns` (1, n + c + 7, K, P) for each target,
    as `Problem.columns_in_mm` has them: the unknowns, the errors considered, the
    residual, the flange's pose.
    """
    problem = solution.problem
    noise = solution.noise.of_sizes(solution.error_sizes.of_robot)
    observed = []
    parts = zip(
        Problem(problem.observations, noise).terms,
        solution.state.placements,
        columns,
        problem.split(drawn_steps(solution, noise, rng)),
        solution.kept,
        strict=True,
    )
    for term, placement, (z,), steps, kept in parts:
        r = np.einsum("pc,ckp->kp", steps, z)
        here = term.linearise(solution.state, placement)
        observed.append(term.seen_anew(r, here, rng).keep(kept))
    return observed


def drawn_steps(solution: Solution, noise: Noise, rng: Generator) -> ndarray:
    """Steps along all columns, a row for each profile, by random errors as large as
    the solution has them.
    """
    problem = solution.problem
    steps = np.zeros((len(problem.counts), problem.considered_columns.stop + 7))
    # the clock is as the answer has it; single times are drawn below as jitter
    sizes = [0.0 if error.clock else size for error, size in problem.considered.items()]
    steps[:, problem.considered_columns] = sizes * rng.normal(size=len(sizes))
    for name, size in noise.of_robot.items():
        shared = problem.groups.sharing(name)
        errors = rng.normal(size=(shared.max() + 1, 6))[shared]
        steps[:, FLANGE] += size * by_unit(name) * errors
    if noise.accuracy_mm:
        # (profiles, 6, patterns)
        motions = np.broadcast_to(np.eye(6), (len(steps), 6, 6))
        patterns = noise.accuracy_mm * solution.smooth.columns(motions)
        steps[:, FLANGE] += patterns @ rng.normal(size=patterns.shape[2])
    if problem.clock is not None:
        steps[:, problem.clock] = noise.jitter_ms / 1000 * rng.normal(size=len(steps))
    return steps


def guessed_anew(solution: Solution, rng: Generator) -> Prior:
    """The solution's prior; what is known of the mount is off as far as it may be."""
    prior = solution.prior
    if not prior.mount:
        return prior
    sd = prior.mount.sd
    off = np.where(np.isfinite(sd), sd, 0) * rng.normal(size=6)
    R, p = solution.rotation, solution.translation
    drawn = Mount(R @ rotations(off[3:]), p + R @ off[:3], sd)
    return replace(prior, mount=drawn)
