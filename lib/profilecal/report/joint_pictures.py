"""Pictures of the joint solution: what it expects, what motions leave open, errors over noise and over bad points."""

import matplotlib.pyplot as plt
import numpy as np

from profilecal.geometry.poses import rotations
from profilecal.report.figures import BLUE, OF_METHOD, ORANGE, draw_scan, equal_axes


def draw_seen_and_expected(axes, scene, turn_deg: float, shift_mm: float) -> None:
    """Draw one scan of a `scene.Scene` (dots), and what a sensor pose that wrong expects in its place (crosses)."""
    seen, truth = scene.observations, scene.truth
    k = seen.points.shape[1] // 2
    R = truth.rotation[0] @ rotations(np.radians(turn_deg) * np.ones(3) / np.sqrt(3))
    rotation = seen.R_flange[0, k] @ R
    origin = seen.R_flange[0, k] @ (truth.translation[0] + shift_mm * np.ones(3) / np.sqrt(3)) + seen.T_flange[0, k]
    count = seen.points.shape[-2]
    (expected,) = scene.target.points_seen(rotation[None], origin[None], count)
    x, z = seen.points[0, k].T
    on_curve = seen.on_curve
    line = "-" if count > 1 else ""
    axes.plot(x, z, "." if on_curve else "o" + line, color=BLUE, label="seen")
    axes.plot(*expected.T, "-" if on_curve else "x" + line, ms=8, mew=2, color=ORANGE, label="expected")
    if not on_curve:
        axes.plot(*np.stack([seen.points[0, k], expected]).transpose(2, 0, 1), "k:", lw=1)
    axes.set(title=seen.kind, xlabel="x in the scan [mm]", ylabel="z in the scan [mm]")
    axes.margins(0.3)
    axes.invert_yaxis()


def draw_motion(axes, scene, other) -> None:
    """Draw the first problem of a `scene.Scene` in 3D, as it is and with the sensor pose and the target of `other`, a
    `State`: where the sensor was (dots), its fan of light in two orientations, and the target."""
    seen, drawn = scene.observations, []
    firsts = np.unique(seen.group, return_index=True)[1]
    firsts = firsts[np.unique(np.linspace(0, len(firsts) - 1, 2).astype(int))]
    for state, colour, name in ((scene.truth, BLUE, "the mount"), (other, ORANGE, "the other mount")):
        rotation = seen.R_flange[0] @ state.rotation[0]
        origin = seen.T_flange[0] + seen.R_flange[0] @ state.translation[0]
        target = type(scene.target).at(state.placements[0][0][0], state.placements[0][1][0], seen.sizes)
        middle, along = target.frame[0], target.frame[1][:, 2]
        axes.plot(*origin[firsts].T, "o", color=colour, ms=5, label=name)
        for k in firsts:
            draw_scan(axes, rotation[k], origin[k], 80.0, colour)
        for line in target.lines(middle + np.outer([-60, 60], along)):
            axes.plot(*line.T, color=colour, lw=3, label="its target" if colour == BLUE else "its target ")
            drawn.append(line)
        drawn.append(origin[firsts])
    equal_axes(axes, np.vstack(drawn))
    axes.set_box_aspect((1, 1, 1), zoom=1.7)
    axes.set_axis_off()


def draw_two_scans(axes, scene, other) -> float:
    """Draw the points that a perfect scanner sees in the first problem of a `scene.Scene` (dots), and with the sensor
    pose and target of `other`, a `State` (circles). Returns their rms difference, mm."""
    seen, points = scene.observations, []
    for state in (scene.truth, other):
        target = type(scene.target).at(state.placements[0][0][0], state.placements[0][1][0], seen.sizes)
        rotation = seen.R_flange[0] @ state.rotation[0]
        origin = seen.T_flange[0] + seen.R_flange[0] @ state.translation[0]
        points.append(target.points_seen(rotation, origin, seen.points.shape[-2]).reshape(-1, 2))
    axes.plot(*points[0].T, ".", color=BLUE, ms=5)
    axes.plot(*points[1].T, "o", color=ORANGE, mfc="none", ms=8)
    difference = float(np.sqrt(np.nanmean((points[0] - points[1]) ** 2)))
    text = "the scans are identical" if difference < 1e-6 else f"the scans differ by {difference:.2g} mm"
    axes.set(title=text, xlabel="x in the scan [mm]", ylabel="z in the scan [mm]")
    axes.margins(0.15)
    axes.invert_yaxis()
    return difference


def plot_bands(axes, x, bands: dict) -> None:
    """Draw lines over x (n,) with a band around each, {name: low, middle, high (3, n)}."""
    shades = plt.get_cmap("viridis")(np.linspace(0, 0.8, len(bands)))
    markers = ("o-", "s-", "^-", "D-", "v-", "P-")
    for (name, (low, middle, high)), shade, marker in zip(bands.items(), shades, markers, strict=False):
        axes.loglog(x, middle, marker, color=shade, ms=5, label=name)
        axes.fill_between(x, low, high, color=shade, alpha=0.2, lw=0)


def draw_error_against_noise(axes, errors) -> None:
    """Draw the errors of methods (columns, in degrees) and the bound over the column "sigma_mm"."""
    looks = {
        "closed form": (OF_METHOD["closed form"], "o-"),
        "closed form, all heights": (OF_METHOD["closed form"], "^:"),
        "joint": (OF_METHOD["joint"], "s-"),
        "bound": (OF_METHOD["bound"], "--"),
    }
    for name, (colour, line) in looks.items():
        if errors[name].notna().any():
            axes.loglog(errors["sigma_mm"], errors[name], line, color=colour, ms=5, label=name)


def plot_coverage(axes, inside: dict, band: float) -> None:
    """Draw, for each name, how many of the values (n,), in order, are below a probability, less that probability; and a
    grey band as high as chance reaches."""
    shades = plt.get_cmap("viridis")(np.linspace(0, 0.85, len(inside)))
    lines = ("-", "--", "-.", ":", (0, (6, 1)), (0, (3, 1, 1, 1, 1, 1)))
    for (name, values), shade, line in zip(inside.items(), shades, lines, strict=False):
        axes.plot(values, np.arange(1, len(values) + 1) / len(values) - values, color=shade, ls=line, label=name)
    axes.axhspan(-band, band, color="0.9", zorder=0)
    axes.axhline(0, color="black", lw=1)


def draw_breakdown(axes, runs, methods) -> None:
    """Draw the median rotation and translation errors of methods over the share of bad points, one above the other.

    `runs`: rows of `outlier_study.compare` with the column "percent". Bands hold the middle 80 % of the runs.
    """
    looks = {
        "two-phase": (OF_METHOD["closed form"], "o-"),
        "two-phase, screened": (OF_METHOD["closed form"], "^:"),
        "least squares": (OF_METHOD["joint"], "s-"),
        "robust joint": (OF_METHOD["robust joint"], "D-"),
        "good points alone": (OF_METHOD["bound"], "--"),
    }
    for method in methods:
        colour, line = looks[method]
        for ax, error in zip(axes, ("rotation", "translation"), strict=True):
            by_share = runs[runs["method"] == method].groupby("percent")[error]
            middle, low, high = (by_share.quantile(q) for q in (0.5, 0.1, 0.9))
            ax.semilogy(middle.index, middle, line, color=colour, label=method, ms=5)
            if method == "robust joint":
                ax.fill_between(low.index, low, high, color=colour, alpha=0.15, lw=0)
