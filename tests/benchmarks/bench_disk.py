"""The noise study of disks against its own random numbers, and against loops over
peers' ellipse fits.
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


def by_opencv(points) -> Ellipse:
    import cv2

    # the fit is in float32: about the mean, so that little is lost
    mean = points.mean(axis=0)
    about_mean = (points - mean).astype(np.float32)
    centre, diameters, degrees = cv2.fitEllipseDirect(about_mean)
    return ellipse_of_axes(mean + centre, np.array(diameters) / 2, np.radians(degrees))


def by_skimage(points) -> Ellipse:
    from skimage.measure import EllipseModel

    ellipse = EllipseModel.from_estimate(points)
    centre, semi_axes = np.array(ellipse.center), np.array(ellipse.axis_lengths)
    return ellipse_of_axes(centre, semi_axes, ellipse.theta)


def ellipse_of_axes(centre, semi_axes, angle) -> Ellipse:
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return Ellipse(centre, turn @ np.diag(np.square(semi_axes)) @ turn.T)


def loop(fit, m: int, trials: int, sigma_mm: float) -> np.ndarray:
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
            ellipse = fit((tips + noise[i, k] * along[i]).reshape(-1, 2))
            scan = scans.T_start[i], scans.T_end[i], scans.s[i], scans.disk.radius
            data.append(sensing_data_from_ellipse(ellipse, vectors[i], *scan))
        fields = (
            np.array([getattr(d, name) for d in data])
            for name in ("T_tcp", "q", "D_i", "D_b")
        )
        centres[k] = disk_equations(scans.R_tcp, *fields).translation.q_b
    return centres - scans.disk.centre


def against_a_loop(name: str, fit, least: int, closeness_mm: float) -> dict:
    """One calibration, against a loop over a peer's fit with the same noise."""
    m, sigma_mm, few, many = 100, 0.4, 100, 2000
    study_s, loop_s = medians(
        lambda: study([sigma_mm], [m], many),
        lambda: loop(fit, m, few, sigma_mm),
        repeats=3,
    )
    ours_s, theirs_s = study_s / many, loop_s / few
    errors = study([sigma_mm], [m], few).centre_error[0, 0]
    apart = np.abs(errors - loop(fit, m, few, sigma_mm)).max()
    ours = f"one calibration, m = 100 (largest difference {apart:.0e} mm)"
    target = f"≥ {least} × faster, within {closeness_mm:g} mm"
    met = theirs_s >= least * ours_s and apart <= closeness_mm
    return row(ours, ours_s, name, theirs_s, theirs_s / ours_s, target, met)


def rows() -> list[dict]:
    ours_s, draw_s = medians(study, draw)
    return [
        at_most(2, "Fig. 15 grid, chord noise", ours_s, "drawing its normals", draw_s),
        against_a_loop("loop with OpenCV's fitEllipseDirect", by_opencv, 50, 1e-3),
        against_a_loop("loop with scikit-image's EllipseModel", by_skimage, 100, 1e-9),
    ]
