"""The noise study of disks against its own random numbers, and against a loop over a
peer's ellipse fit.
"""

import numpy as np
from bench import at_most, medians, row

from profilecal.closed_form.disk import (
    chord_weights,
    disk_equations,
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
    scans = SCANS
    exact = np.swapaxes(scans.tips(m), 1, 2)
    along = exact[:, 1] - exact[:, 0]
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    rng = np.random.default_rng(0).spawn(1)[0]
    noise = sigma_mm * np.array([rng.standard_normal((trials, 2, m, 1)) for _ in exact])
    vectors = np.swapaxes(exact.reshape(len(exact), 2 * m, 2), 1, 2) @ chord_weights(m)
    centres = np.empty((trials, 3))
    for k in range(trials):
        data = []
        for i, tips in enumerate(exact):
            ellipse = by_skimage((tips + noise[i, k] * along[i]).reshape(-1, 2))
            scan = scans.T_start[i], scans.T_end[i], scans.s[i], scans.disk.radius
            data.append(sensing_data_from_ellipse(ellipse, vectors[i], *scan))
        fields = (
            np.array([getattr(d, name) for d in data])
            for name in ("T_tcp", "q", "D_i", "D_b")
        )
        centres[k] = disk_equations(scans.R_tcp, *fields).translation.q_b
    return centres - scans.disk.centre


def against_a_loop() -> dict:
    """One calibration, against a loop over a peer's fit with the same noise."""
    m, sigma_mm, few, many = 100, 0.4, 100, 2000
    study_s, loop_s = medians(
        lambda: study([sigma_mm], [m], many),
        lambda: loop(m, few, sigma_mm),
        repeats=3,
    )
    ours_s, theirs_s = study_s / many, loop_s / few
    errors = study([sigma_mm], [m], few).centre_error[0, 0]
    apart = np.abs(errors - loop(m, few, sigma_mm)).max()
    ours = f"one calibration, m = 100 (largest difference {apart:.0e} mm)"
    theirs = "loop with scikit-image's EllipseModel"
    met = theirs_s >= 100 * ours_s and apart <= 1e-9
    target = "≥ 100 × faster, within 1e-09 mm"
    return row(ours, ours_s, theirs, theirs_s, theirs_s / ours_s, target, met)


def rows() -> list[dict]:
    ours_s, draw_s = medians(study, draw)
    return [
        at_most(2, "Fig. 15 grid, chord noise", ours_s, "drawing its normals", draw_s),
        against_a_loop(),
    ]
