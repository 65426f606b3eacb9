"""The noise studies against their own random numbers, against loops over peers' ellipse
fits, and on two workers.
"""

import time

import numpy as np
from bench import at_most, medians, row

from profilecal.closed_form.disk import (
    chord_weights,
    disk_equations,
    sensing_data_from_ellipse,
)
from profilecal.geometry.fitting import Ellipse
from profilecal_papers.ball_study import fig17_scans, mean_centres
from profilecal_papers.disk_study import disk_study, fig15_scans
from profilecal_papers.monte_carlo import BLOCK

SCANS = fig15_scans()
SIGMA_MM, M, TRIALS = np.arange(1, 10) / 10, np.arange(10, 201, 10), 500


def study(workers=1, sigma_mm=SIGMA_MM, m=M, trials=TRIALS, **kind):
    return disk_study(
        SCANS, sigma_mm, m, trials, np.random.default_rng(0), workers=workers, **kind
    )


def draw(per_chord: int) -> None:
    """The normals of the whole grid, from the streams and into the buffers that the
    study uses.
    """
    streams = np.random.default_rng(0).spawn(len(SIGMA_MM) * len(M))
    for i, stream in enumerate(streams):
        chords = M[i % len(M)]
        for _ in range(4):  # scans
            draw_blocks(per_chord * chords, stream)


def draw_blocks(numbers: int, stream: np.random.Generator) -> None:
    """So many normals for each trial."""
    block = np.empty((BLOCK // numbers, numbers))
    for first in range(0, TRIALS, len(block)):
        stream.standard_normal(out=block[: TRIALS - first])


def against_the_draw(name, ours, per_chord, most) -> dict:
    ours_s, draw_s = medians(ours, lambda: draw(per_chord))
    return at_most(most, name, ours_s, "drawing its normals", draw_s)


def ball_arcs() -> dict:
    scans, arcs = fig17_scans(), 30
    sizes = [len(scans.x_seen(circle)) for circle in scans.circles(arcs).reshape(-1, 3)]

    def only_draw():
        rng = np.random.default_rng(0)
        for points in sizes:
            draw_blocks(points, rng)

    def ours():
        rng = np.random.default_rng(0)
        for pose in range(len(scans.R_tcp)):
            mean_centres(scans, pose, [arcs], SIGMA_MM, TRIALS, rng)

    ours_s, draw_s = medians(ours, only_draw)
    name = f"ball arcs, 500 × 240, {len(SIGMA_MM)} noise levels"
    return at_most(2.5, name, ours_s, "drawing normals for one level", draw_s)


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
        lambda: study(1, [sigma_mm], [m], many),
        lambda: loop(fit, m, few, sigma_mm),
        repeats=3,
    )
    ours_s, theirs_s = study_s / many, loop_s / few
    errors = study(1, [sigma_mm], [m], few).centre_error[0, 0]
    apart = np.abs(errors - loop(fit, m, few, sigma_mm)).max()
    ours = f"one calibration, m = 100 (largest difference {apart:.0e} mm)"
    target = f"≥ {least} × faster, within {closeness_mm:g} mm"
    met = theirs_s >= least * ours_s and apart <= closeness_mm
    return row(ours, ours_s, name, theirs_s, theirs_s / ours_s, target, met)


def linear(name: str, factor: float, small: dict, **larger) -> dict:
    """`factor` times the work takes as many times as long."""
    small_s, large_s = medians(lambda: study(**small), lambda: study(**small | larger))
    return at_most(1.15, name, large_s, f"{factor:g} times as long", factor * small_s)


def two_workers() -> dict:
    one_s, two_s = medians(
        lambda: study(1, trials=1000),
        lambda: study(2, trials=1000),
        clock=time.perf_counter,
    )
    name = "Fig. 15 grid × 2, two workers (wall time)"
    ratio = one_s / two_s
    return row(name, two_s, "one worker", one_s, ratio, "≥ 1.7 × faster", ratio >= 1.7)


def rows() -> list[dict]:
    small = {"sigma_mm": [0.4], "m": [200]}
    return [
        against_the_draw("Fig. 15 grid, chord noise", study, 2, 2.0),
        against_the_draw(
            "Fig. 15 grid, isotropic noise", lambda: study(noise="isotropic"), 4, 2.5
        ),
        ball_arcs(),
        against_a_loop("loop with OpenCV's fitEllipseDirect", by_opencv, 50, 1e-3),
        against_a_loop("loop with scikit-image's EllipseModel", by_skimage, 100, 1e-9),
        two_workers(),
        linear("m = 2000 against 200", 10, small, m=[2000]),
        linear("5000 trials against 500", 10, small | {"m": [100]}, trials=5000),
    ]
