"""The noise study of disks against its own random numbers, and against a loop over its
calibrations.
"""

import numpy as np
from bench import at_most, least
from disk_trials import one_by_one

from profilecal_papers.disk_study import disk_study, fig15_scans
from profilecal_papers.monte_carlo import BLOCK

SCANS = fig15_scans()
SIGMA_MM, M, TRIALS = np.arange(1, 10) / 10, np.arange(10, 201, 10), 500


def study(sigma_mm=SIGMA_MM, m=M, trials=TRIALS):
    return disk_study(SCANS, sigma_mm, m, trials, np.random.default_rng(0), workers=1)


def draw() -> None:
    """The normals of the whole grid, two a chord, from the streams and into the buffers
    that the study uses.
    """
    streams = np.random.default_rng(0).spawn(len(SIGMA_MM) * len(M))
    for i, stream in enumerate(streams):
        numbers = 2 * M[i % len(M)]
        block = np.empty((BLOCK // numbers, numbers))
        for _ in range(4):  # scans
            for first in range(0, TRIALS, len(block)):
                stream.standard_normal(out=block[: TRIALS - first])


def against_a_loop() -> dict:
    """One calibration, against a loop over calibrations with the same noise."""
    m, sigma_mm, few, many = 100, 0.4, 100, 2000

    def loop():
        return one_by_one(SCANS, sigma_mm, m, few, np.random.default_rng(0))

    study_s, loop_s = least(lambda: study([sigma_mm], [m], many), loop, repeats=3)
    errors = study([sigma_mm], [m], few).centre_error[0, 0]
    apart = np.abs(errors - loop()[:, :3]).max()
    ours = f"one calibration, m = 100 (largest difference {apart:.0e} mm)"
    ours_s, theirs_s = study_s / many, loop_s / few
    return at_most(0.01, ours, ours_s, "one by one", theirs_s, apart <= 1e-9)


def rows() -> list[dict]:
    ours_s, draw_s = least(study, draw)
    return [
        at_most(2, "Fig. 15 grid, chord noise", ours_s, "drawing its normals", draw_s),
        against_a_loop(),
    ]
