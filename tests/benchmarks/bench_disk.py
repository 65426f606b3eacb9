"""The noise study of disks against its own random numbers, and against a loop over a
peer's ellipse fit.
"""

import numpy as np
from bench import at_most, least
from disk_trials import noisy_tips, solved

from profilecal.closed_form.disk import (
    chord_weights,
    sensing_data_from_ellipse,
)
from profilecal.geometry.fitting import Ellipse
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


def by_skimage(points) -> Ellipse:
    from skimage.measure import EllipseModel

    ellipse = EllipseModel.from_estimate(points)
    cosine, sine = np.cos(ellipse.theta), np.sin(ellipse.theta)
    turn = np.array([[cosine, -sine], [sine, cosine]])
    squares = np.diag(np.square(ellipse.axis_lengths))
    return Ellipse(np.array(ellipse.center), turn @ squares @ turn.T)


def loop(m: int, trials: int, sigma_mm: float) -> np.ndarray:
    """Disk centres of `trials` calibrations one by one, from the random numbers of
    `disk_study`'s first stream.
    """
    rng = np.random.default_rng(0).spawn(1)[0]
    exact = np.swapaxes(SCANS.tips(m), 1, 2).reshape(-1, 2 * m, 2)
    vectors = np.swapaxes(exact, 1, 2) @ chord_weights(m)
    scans = [*zip(vectors, SCANS.T_start, SCANS.T_end, SCANS.s, strict=True)]
    centres = []
    for tips in noisy_tips(SCANS, sigma_mm, m, "chord", rng, trials):
        ellipses = map(by_skimage, tips.reshape(-1, 2 * m, 2))
        data = [
            sensing_data_from_ellipse(ellipse, *scan, SCANS.disk.radius)
            for ellipse, scan in zip(ellipses, scans, strict=True)
        ]
        centres.append(solved(SCANS, data).translation.q_b)
    return np.array(centres) - SCANS.disk.centre


def against_a_loop() -> dict:
    """One calibration, against a loop over a peer's fit with the same noise."""
    m, sigma_mm, few, many = 100, 0.4, 100, 2000
    study_s, loop_s = least(
        lambda: study([sigma_mm], [m], many),
        lambda: loop(m, few, sigma_mm),
        repeats=3,
    )
    ours_s, theirs_s = study_s / many, loop_s / few
    errors = study([sigma_mm], [m], few).centre_error[0, 0]
    apart = np.abs(errors - loop(m, few, sigma_mm)).max()
    ours = f"one calibration, m = 100 (largest difference {apart:.0e} mm)"
    theirs = "loop with scikit-image's EllipseModel"
    return at_most(0.01, ours, ours_s, theirs, theirs_s, apart <= 1e-9)


def rows() -> list[dict]:
    ours_s, draw_s = least(study, draw)
    return [
        at_most(2, "Fig. 15 grid, chord noise", ours_s, "drawing its normals", draw_s),
        against_a_loop(),
    ]
