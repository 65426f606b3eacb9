"""Pictures for the report, of a calibration's robot and profiles; and of a plan."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from textwrap import fill

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from mpl_toolkits.mplot3d import Axes3D
from numpy import ndarray

from profilecal.calibration.calibration import Calibration
from profilecal.geometry.observability import WEAK, name_direction, size_direction
from profilecal.geometry.poses import in_base
from profilecal.profiles.points import Feature
from profilecal.scan.scan import Scan
from profilecal.targets.observations import Observations
from profilecal_pages.figures import (
    BLUE,
    GREEN,
    ORANGE,
    RED,
    SKY,
    draw_frame,
    draw_patch,
    equal_axes,
    use_style,
)
from profilecal_tool.plan.design import Plan
from profilecal_tool.plan.scan_model import ScanModel
from profilecal_tool.report.calibration import chance_limits


def plot_robot(calibration: Calibration) -> plt.Figure:
    """Draw the flange's poses and where the calibration puts scan planes and targets.

    All is in the base frame.
    """
    scans = calibration.scans
    figure = plt.figure(figsize=(5.6, 5.2))
    axes = figure.add_subplot(projection="3d")
    drawn = [scan.p_base_flange for scan in scans]
    size = 0.08 * np.ptp(np.concatenate(drawn), axis=0).max() + 5
    count = sum(len(scan.labels) for scan in scans)
    step, words = thinned(count, 2000)
    for k, scan in enumerate(scans):
        few = spread(len(scan.labels), max(1, 24 // len(scans)))
        positions = scan.p_base_flange
        dots = positions[::step].T
        axes.scatter(*dots, color="0.35", s=6, depthshade=False, label="flange")
        for i in few:
            draw_frame(axes, scan.R_base_flange[i], positions[i], size)
        if calibration.is_known:
            drawn += draw_answer(axes, calibration, k, few, size)
    in_frame(axes, "base", np.concatenate(drawn))
    figure.suptitle(f"Where the robot went: {count} poses{words}")
    key(figure, axes)
    return figure


def in_frame(axes: Axes3D, frame: str, points: ndarray) -> None:
    """Name the axes of a 3D plot and give them one scale, around points (n, 3)."""
    equal_axes(axes, points)
    axes.set(**{f"{axis}label": f"{frame} {axis} [mm]" for axis in "xyz"})
    axes.locator_params(nbins=4)


def spread(count: int, most: int) -> ndarray:
    """Up to `most` of so many numbers from 0, from the first to the last."""
    return np.unique(np.linspace(0, count - 1, most).round().astype(int))


def thinned(count: int, most: int) -> tuple[int, str]:
    """The step at which at most so many of `count` are drawn, and what says so."""
    step = max(1, -(-count // most))
    return step, f" (one in {step} is drawn)" if step > 1 else ""


def draw_answer(
    axes: Axes3D, calibration: Calibration, k: int, few: ndarray, size: float
) -> list[ndarray]:
    """Draw where scan `k` has the sensor and the target at a few poses.

    Returns the points that are drawn.
    """
    scan, observed = calibration.scans[k], calibration.observed[k]
    solution = calibration.solution
    R, T = scan.R_base_flange, scan.p_base_flange
    flange = observed.R_flange[0], observed.T_flange[0]
    points, _ = in_base(solution.pose, observed.points[0], *flange)
    lines = solution.placements[k].lines(points)
    drawn = []
    if calibration.frame == "flange":
        for i in few[::3]:
            origin = T[i] + R[i] @ solution.translation
            axes.plot(
                *np.stack([T[i], origin]).T,
                color="0.6",
                lw=0.8,
                ls="--",
                marker="o",
                ms=4,
                markevery=[1],
                label="to the sensor's origin",
            )
            rotation = R[i] @ solution.rotation
            drawn += [draw_seen(axes, observed, rotation, origin), origin[None]]
    else:
        rotation, origin = solution.rotation, solution.translation
        draw_frame(axes, rotation, origin, 3 * size)
        drawn += [draw_seen(axes, observed, rotation, origin), origin[None]]
        lines = [line @ R[i].T + T[i] for i in few for line in lines]
    label = f"{scan.kind}, where the scans place it"
    return [*drawn, draw_lines(axes, lines, "black", label)]


def key(figure: plt.Figure, axes: Axes) -> None:
    """Draw a legend below the figure, each label once."""
    handles, labels = axes.get_legend_handles_labels()
    once = dict(zip(labels, handles, strict=True))
    figure.legend(once.values(), once, loc="outside lower center", ncols=2)


def draw_seen(
    axes: Axes3D, observed: Observations, rotation: ndarray, origin: ndarray
) -> ndarray:
    """Draw the part of the scan plane in which a sensor there saw nearly all.

    Returns its corners (4, 3).
    """
    points = observed.points[0].reshape(-1, 2)
    x, z = np.nanpercentile(points, [1, 99], axis=0).T
    in_plane = np.stack([x[[0, 1, 1, 0]], z[[0, 0, 1, 1]]], axis=-1)
    corners = origin + in_plane @ rotation[:, ::2].T
    draw_patch(axes, corners, SKY, label="seen in the scan plane")
    return corners


def draw_lines(axes: Axes3D, lines: list[ndarray], colour: str, label: str) -> ndarray:
    """Draw polylines (n, 3) in a 3D plot; return their points."""
    for line in lines:
        axes.plot(*line.T, color=colour, lw=3 if len(lines) == 1 else 1, label=label)
    return np.concatenate(lines)


def plot_profiles(
    scan: Scan, rejected: Iterable[str] = (), most: int = 120
) -> Iterator[plt.Figure]:
    """Draw profiles of a scan with what was found in them, 20 to a figure.

    Of more than `most` they are as many, evenly spread. All are at one scale; there are
    no figures where there are no raw profiles. `rejected`: labels of the poses that the
    calibration rejects.
    """
    if scan.measured != "profiles":
        return
    features = scan.target.find(scan.values, *scan.sizes)
    step, words = thinned(len(features), most)
    drawn = range(0, len(features), step)
    valid = [scan.values[i][np.isfinite(scan.values[i]).all(axis=1)] for i in drawn]
    extents = [np.ptp(values, axis=0) for values in valid if len(values)]
    width, height = 1.2 * np.percentile(extents, 90, axis=0)
    cell = np.array([width, np.clip(height, 0.4 * width, 0.75 * width)])
    for first in range(0, len(drawn), 20):
        page = drawn[first : first + 20]
        yield profile_page(scan, features, page, cell, set(rejected), words)


def profile_page(
    scan: Scan,
    features: list[Feature],
    page: range,
    cell: ndarray,
    rejected: set[str],
    words: str,
) -> plt.Figure:
    """Draw one figure of `plot_profiles`, whose title ends in some words."""
    columns = 4
    rows = -(-len(page) // columns)
    width, height = cell
    tall = 5.6 / columns * (rows + 0.2) * 1.3 * height / width
    figure, places = plt.subplots(
        rows, columns, figsize=(5.6, tall), squeeze=False, layout="constrained"
    )
    for axes in places.flat[len(page) :]:
        axes.axis("off")
    for axes, i in zip(places.flat, page, strict=False):
        note = "rejected" if scan.labels[i] in rejected else ""
        if features[i].reason:
            note = "not found"
        label = f"{scan.labels[i][:10]} {note}".strip()
        axes.set_title(label, color=RED if note else "0.2", fontsize=8)
        axes.set(aspect="equal", xticks=[], yticks=[])
        draw_profile(axes, scan, scan.values[i], features[i], cell)
    count = sum(features[i].found for i in page)
    figure.suptitle(
        f"Profiles {page[0] + 1} to {page[-1] + 1} of {len(features)}: "
        f"{count} features found; a frame is {width:.0f} mm wide{words}"
    )
    return figure


def draw_profile(
    axes: Axes,
    scan: Scan,
    values: ndarray,
    feature: Feature,
    cell: ndarray,
) -> None:
    """Draw one profile, z downwards, as far as a cell shows it.

    The points that its feature rests on are blue.
    """
    valid = np.isfinite(values).all(axis=1)
    if not valid.any():
        return
    used = valid & np.isin(np.arange(len(values)), feature.used)
    shown = values[used] if used.any() else values[valid]
    centre = (shown.min(axis=0) + shown.max(axis=0)) / 2

    for rows, colour in ((valid & ~used, "0.6"), (used, BLUE)):
        axes.plot(*values[rows].T, ".", ms=1.2, color=colour, rasterized=True)
    if feature.found and scan.target.points:
        axes.plot(*feature.points.T, "o", ms=5, mfc="none", mec=RED, mew=1.3)
    (x, z), (width, height) = centre, cell / 2
    axes.set(xlim=(x - width, x + width), ylim=(z + height, z - height))


def plot_residuals(found: Calibration) -> plt.Figure:
    """Draw each pose's residual over the noise, and what chance explains."""
    scans, solution = found.scans, found.solution
    size = (5.6, 3.2 * len(scans))
    figure, rows = plt.subplots(len(scans), figsize=size, squeeze=False)
    of_poses = solution.normalised, solution.rejected, chance_limits(found)
    for parts in zip(rows[:, 0], scans, found.seen, *of_poses, strict=True):
        draw_residuals(*parts)
    key(figure, rows[-1, 0])
    return figure


def draw_residuals(
    axes: Axes, scan: Scan, seen: ndarray, size: ndarray, bad: ndarray, limit: ndarray
) -> None:
    """Draw the residuals of a scan's poses (k,), shaded by orientation, and the largest
    ones that chance explains. Those of `bad` poses are all drawn, as crosses.
    """
    top = 1.15 * max([*size[~bad], *limit])
    good = np.flatnonzero(~bad)
    step, words = thinned(len(good), 1000)
    few = good[::step]
    colours = np.where(scan.group[seen[few]] % 2, SKY, BLUE)
    axes.bar(seen[few], size[few], 0.8 * step, color=colours)
    crosses = np.minimum(size[bad], 0.97 * top)
    axes.plot(seen[bad], crosses, "x", color=RED, label="rejected")
    axes.plot(seen, limit, "--", color=RED, lw=1, label="limit of chance")
    ticks = seen[:: 1 + len(seen) // 7]
    axes.set_xticks(ticks, [scan.labels[i][:8] for i in ticks])
    axes.set(xlabel="pose", ylabel="residual / noise", ylim=(0, top))
    inside = np.count_nonzero((size <= limit) & ~bad)
    title = f"chance explains {inside} of {len(seen)} residuals{words}"
    axes.set_title(f"{scan.title or scan.kind}:\n{title}")


def save_plan(plan: Plan, path: Path) -> None:
    """Write the picture of a plan as a PNG file."""
    use_style()
    figure, axes = plt.subplots(figsize=(7, 5.5), subplot_kw={"projection": "3d"})
    draw_way(axes, plan)
    prediction = plan.predicted
    count = f"{len(plan.T) // 2} sweeps" if plan.speed else f"{len(plan.T)} poses"
    axes.set_title(
        f"{count} over the {plan.model.target.kind} (black): "
        f"{prediction.mm:.2g} mm and {prediction.deg:.2g}° predicted"
    )
    figure.savefig(path, dpi=150)
    plt.close(figure)


def draw_way(axes: Axes3D, plan: Plan) -> None:
    """Draw the sensor's way and some fields of view in 3D.

    Eye-to-hand, they are in the frame of the flange and target.
    """
    model = plan.model
    fans = field_of_view(model) @ plan.R.mT + plan.T[:, None]
    origins = fans[:, 0]
    axes.plot(*origins.T, color=BLUE, lw=0.8, alpha=0.6)
    axes.scatter(
        *origins.T, color=BLUE, s=8, depthshade=False, label="sensor, on its way"
    )
    R_view, T_view = model.planes(plan.R, plan.T)
    size = 0.06 * np.ptp(fans, axis=(0, 1)).max()
    few = spread(len(fans), 5)
    for k in few:
        draw_patch(axes, fans[k, 1:], SKY, 0.12, "field of view" if k == few[0] else "")
        draw_frame(axes, R_view[k], origins[k], size)
    seen = model.points_seen(R_view, T_view, 5) @ R_view[..., ::2].mT + T_view[:, None]
    target = draw_lines(axes, model.target.lines(seen.reshape(-1, 3)), "black", "")
    frame = "flange" if model.to_hand else "base"
    in_frame(axes, frame, np.vstack([origins, fans[few].reshape(-1, 3), target]))
    axes.computed_zorder = False
    axes.legend(loc="upper left", fontsize=8)


def field_of_view(model: ScanModel) -> ndarray:
    """The sensor's origin and the corners of its field of view, (5, 3), mm.

    They are in the frame that the sensor is fixed to.
    """
    near, far = model.scanner.near, model.scanner.far
    z = np.array([0, near, far, far, near])
    x = model.scanner.half_width(z) * [0, -1, -1, 1, 1]
    return np.stack([x, z], axis=1) @ model.R_sensor[:, ::2].T + model.T_sensor


def plot_directions(found: Calibration) -> plt.Figure:
    """How well each of the six directions of the sensor's pose is known, worst first.

    The scale counts 10 mm and 5° alike, as a measurement by hand is known.
    """
    solution, known = found.solution, found.solution.observability
    figure, axes = plt.subplots(figsize=(5.6, 4.8))
    colours = np.select([known.sd >= 1, known.sd >= WEAK], [RED, ORANGE], GREEN)
    low = min(known.sd[-1] / 3, 0.01)
    axes.barh(range(6), np.minimum(known.sd, 10), 0.3, color=colours)
    for y, (sd, direction) in enumerate(zip(known.sd, known.directions, strict=True)):
        size = size_direction(sd, direction) if sd < 1 else "unobservable"
        name = name_direction(direction, solution.rotation, found.frame)
        text = fill(f"{name}: {size}", 80)
        axes.text(1.1 * low, y - 0.2, text, fontsize=8, va="bottom")
    axes.set(xscale="log", xlim=(low, 10), ylim=(5.5, -0.8), yticks=[])
    axes.set_xlabel("standard deviation")
    axes.xaxis.set_major_formatter(lambda sd, _: f"{10 * sd:g} mm\n{5 * sd:g}°")
    figure.suptitle(f"The weakest direction of the sensor's pose is {known.status}")
    return figure
