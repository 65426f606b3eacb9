"""Pictures for the report, of a calibration's robot and profiles; and of a plan."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from textwrap import fill

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D
from numpy import ndarray

from profilecal.calibration.calibration import Calibration
from profilecal.calibration.points import points_seen
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
from profilecal_tool.report.calibration import chance_limits

WIDTH = 5.6  # inches, of a page's pictures
OF_PAGE = 20  # profiles


def panels(
    rows: int, columns: int, height: float, title: str = ""
) -> tuple[plt.Figure, Sequence[Axes]]:
    """A figure as wide as the page of so many panels, row by row, each so many inches
    high.
    """
    figure, places = plt.subplots(
        rows,
        columns,
        figsize=(WIDTH, rows * height),
        squeeze=False,
        layout="constrained",
    )
    figure.suptitle(title)
    return figure, places.ravel()


def plot_robot(found: Calibration) -> plt.Figure:
    """The flange's poses, and where the calibration puts scan planes and targets, in
    the base frame.
    """
    figure = plt.figure(figsize=(WIDTH, 5.2))
    axes = figure.add_subplot(projection="3d")
    positions = np.concatenate([scan.p_base_flange for scan in found.scans])
    size = 0.08 * np.ptp(positions, axis=0).max() + 5
    axes.scatter(*positions.T, color="0.35", s=6, depthshade=False, label="flange")
    drawn = [positions]
    for k, scan in enumerate(found.scans):
        few = spread(len(scan.labels), max(1, 24 // len(found.scans)))
        flange = scan.R_base_flange[few], scan.p_base_flange[few]
        for R, T in zip(*flange, strict=True):
            draw_frame(axes, R, T, size)
        if found.is_known:
            drawn += draw_answer(axes, found, k, flange, size)
    in_frame(axes, "base", np.concatenate(drawn))
    figure.suptitle(f"Where the robot went: {len(positions)} poses")
    key(figure, axes)
    return figure


def draw_answer(
    axes: Axes3D, found: Calibration, k: int, flange: tuple, size: float
) -> list[ndarray]:
    """Draw where scan `k` has the sensor and the target at some flange poses (n, 3, 3),
    (n, 3); return the points that are drawn.
    """
    observed, solution = found.observed[k], found.solution
    poses = observed.R_flange[0], observed.T_flange[0]
    points, _ = in_base(solution.pose, observed.points[0], *poses)
    lines = solution.placements[k].lines(points)
    poses = [*zip(*flange, strict=True)]
    drawn = []
    if observed.eye_to_hand:
        rotation, origin = solution.rotation, solution.translation
        draw_frame(axes, rotation, origin, 3 * size)
        drawn.append(draw_seen(axes, observed, rotation, origin))
        lines = [line @ R.T + T for R, T in poses for line in lines]
    else:
        for R, T in poses[::3]:
            origin = T + R @ solution.translation
            way = np.stack([T, origin])
            axes.plot(*way.T, "--", color="0.6", lw=0.8, label="to the sensor's origin")
            axes.scatter(*origin, color="0.6", s=12)
            drawn.append(draw_seen(axes, observed, R @ solution.rotation, origin))
    label = f"{observed.kind}, where the scans place it"
    return [*drawn, draw_lines(axes, lines, "black", label)]


def draw_seen(
    axes: Axes3D, observed: Observations, rotation: ndarray, origin: ndarray
) -> ndarray:
    """Draw the part of the scan plane in which a sensor there saw nearly all.

    Returns its corners and the sensor's origin (5, 3).
    """
    points = observed.points[0].reshape(-1, 2)
    x, z = np.nanpercentile(points, [1, 99], axis=0).T
    corners = np.stack([x[[0, 1, 1, 0]], z[[0, 0, 1, 1]]], axis=-1)
    corners = origin + corners @ rotation[:, ::2].T
    draw_patch(axes, corners, SKY, label="seen in the scan plane")
    return np.vstack([corners, origin])


def draw_lines(axes: Axes3D, lines: list[ndarray], colour: str, label: str) -> ndarray:
    """Draw polylines (n, 3) in a 3D plot; return their points."""
    for line in lines:
        axes.plot(*line.T, color=colour, lw=3 if len(lines) == 1 else 1, label=label)
    return np.concatenate(lines)


def in_frame(axes: Axes3D, frame: str, points: ndarray) -> None:
    """Name the axes of a 3D plot and give them one scale, around points (n, 3)."""
    equal_axes(axes, points)
    axes.set_box_aspect(None, zoom=0.88)  # room for the names
    for axis in "xyz":
        getattr(axes, f"set_{axis}label")(f"{frame} {axis} [mm]", labelpad=9)
    axes.locator_params(nbins=4)


def key(figure: plt.Figure, axes: Axes) -> None:
    """Draw a legend below the figure, each label once."""
    handles, labels = axes.get_legend_handles_labels()
    once = dict(zip(labels, handles, strict=True))
    figure.legend(once.values(), once, loc="outside lower center", ncols=2)


def spread(count: int, most: int) -> ndarray:
    """Up to `most` of so many numbers from 0, from the first to the last."""
    return np.unique(np.linspace(0, count - 1, most).round().astype(int))


def plot_profiles(
    scan: Scan, rejected: Sequence[str] = (), most: int = 120
) -> Iterator[plt.Figure]:
    """Profiles of a scan with what was found in them, 20 to a figure, all at one scale.

    Of more than `most` they are as many, evenly spread. There are no figures where
    there are no raw profiles. `rejected`: labels of the poses that the calibration
    rejects.
    """
    if scan.measured != "profiles":
        return
    features = scan.target.find(scan.values, *scan.sizes)
    step = -(-len(features) // most)
    drawn = range(0, len(features), step)
    words = f" (one in {step} is drawn)" * (step > 1)
    seen = [valid[np.isfinite(valid).all(axis=1)] for valid in scan.values[::step]]
    extents = [np.ptp(points, axis=0) for points in seen if len(points)]
    width, height = 1.2 * np.percentile(extents, 90, axis=0)
    height = np.clip(height, 0.4 * width, 0.75 * width)
    for first in range(0, len(drawn), OF_PAGE):
        page = drawn[first : first + OF_PAGE]
        count = sum(features[i].found for i in page)
        title = (
            f"Profiles {page[0] + 1} to {page[-1] + 1} of {len(features)}: "
            f"{count} features found; a frame is {width:.0f} mm wide{words}"
        )
        figure, places = panels(-(-len(page) // 4), 4, 2 * height / width, title)
        for axes in places[len(page) :]:
            axes.axis("off")
        for axes, i in zip(places, page, strict=False):
            draw_profile(axes, scan, i, features[i], np.array([width, height]))
            note = "rejected" if scan.labels[i] in rejected else ""
            if features[i].reason:
                note = "not found"
            name = f"{scan.labels[i][:10]} {note}".strip()
            axes.set_title(name, color=RED if note else "0.2", fontsize=8)
        yield figure


def draw_profile(
    axes: Axes, scan: Scan, i: int, feature: Feature, size: ndarray
) -> None:
    """Draw a profile, z downwards, as far as a frame of this size (2,), mm, shows it.

    The points that its feature rests on are blue.
    """
    axes.set(aspect="equal", xticks=[], yticks=[])
    values = scan.values[i]
    valid = np.isfinite(values).all(axis=1)
    if not valid.any():
        return
    used = valid & np.isin(np.arange(len(values)), feature.used)
    shown = values[used if used.any() else valid]
    for rows, colour in ((valid & ~used, "0.6"), (used, BLUE)):
        axes.plot(*values[rows].T, ".", ms=1.2, color=colour, rasterized=True)
    if feature.found and scan.target.points:
        axes.plot(*feature.points.T, "o", ms=5, mfc="none", mec=RED, mew=1.3)
    middle = (shown.min(axis=0) + shown.max(axis=0)) / 2
    (left, top), (right, bottom) = middle - size / 2, middle + size / 2
    axes.set(xlim=(left, right), ylim=(bottom, top))


def plot_residuals(found: Calibration) -> plt.Figure:
    """Each pose's residual over the noise, and what chance explains, a panel a scan."""
    solution = found.solution
    figure, rows = panels(len(found.scans), 1, 3.2)
    of_poses = solution.normalised, solution.rejected, chance_limits(found)
    for parts in zip(rows, found.scans, found.seen, *of_poses, strict=True):
        draw_residuals(*parts)
    key(figure, rows[-1])
    return figure


def draw_residuals(
    axes: Axes, scan: Scan, seen: ndarray, size: ndarray, bad: ndarray, limit: ndarray
) -> None:
    """Draw the residuals of a scan's poses (k,), shaded by orientation, and the largest
    ones that chance explains. Those of `bad` poses are all drawn, as crosses.
    """
    top = 1.15 * max([*size[~bad], *limit])
    colours = np.where(scan.group[seen] % 2, SKY, BLUE)
    width = np.clip(300 / len(seen), 0.5, 8)
    axes.vlines(seen[~bad], 0, size[~bad], colours[~bad], lw=width)
    crosses = np.minimum(size[bad], 0.97 * top)
    axes.plot(seen[bad], crosses, "x", color=RED, label="rejected")
    axes.plot(seen, limit, "--", color=RED, lw=1, label="limit of chance")
    ticks = seen[:: 1 + len(seen) // 7]
    axes.set_xticks(ticks, [scan.labels[i][:8] for i in ticks])
    axes.set(xlabel="pose", ylabel="residual / noise", ylim=(0, top))
    inside = np.count_nonzero((size <= limit) & ~bad)
    title = f"chance explains {inside} of {len(seen)} residuals"
    axes.set_title(f"{scan.title or scan.kind}:\n{title}")


# against what residuals are drawn, and what a pattern there means
PATTERNS = {
    "x [mm]": "bow: a bent line, a radius; slope: x's scale",
    "z [mm]": "slope: z's scale",
    "order": "slope: a drift; step: something moved",
    "orientation": "scatter: the robot, or wrong pairs",
}


def plot_patterns(found: Calibration) -> plt.Figure:
    """Residuals against all that faults depend on, each with the fault that a pattern
    there means.
    """
    figure, places = panels(2, 2, 2.2, "A line that is not flat is a pattern")
    draw_patterns(places, found)
    for axes, means in zip(places, PATTERNS.values(), strict=True):
        axes.set_title(means, fontsize=8)
    return figure


def draw_patterns(places: Sequence[Axes], found: Calibration) -> None:
    """Draw how far the points kept are off in z, less the mean of all, each of eight
    parts with its mean, over x, z, order and orientation.
    """
    along = [np.concatenate(parts) for parts in zip(*offsets(found), strict=True)]
    *over, off = along
    off = off - off.mean()  # a scale of z that is put back lifts all alike
    limits = 3 * off.std() * np.array([-1, 1])
    some = slice(None, None, 1 + len(off) // 1500)
    for axes, name, values in zip(places, PATTERNS, over, strict=True):
        axes.plot(values[some], off[some], ".", ms=1.5, color="0.75")
        count, ends = np.histogram(values, 8)
        total, _ = np.histogram(values, ends, weights=off)
        middle, there = (ends[1:] + ends[:-1]) / 2, count > 0
        axes.plot(middle[there], total[there] / count[there], "o-", ms=3, color=RED)
        axes.set(xlabel=name, ylim=limits)
        axes.tick_params(labelsize=8)  # four fit beside each other
    places[0].set_ylabel("off in z [mm]")


def offsets(found: Calibration) -> Iterator[tuple[ndarray, ...]]:
    """Of each scan's points kept: x, z, number of the profile, number of the
    orientation, and how far they are off the target in z, all (n,).
    """
    solution = found.solution
    terms, groups = solution.problem.terms, solution.problem.groups.group
    state = solution.state
    numbers = solution.problem.split(np.arange(len(groups)))
    for parts in zip(terms, state.placements, numbers, solution.kept, strict=True):
        term, placement, number, kept = parts
        on_target = term.on_target(term.linearise(state, placement)).seen
        chosen = term.present[0] & kept
        x, z = term.seen[:, 0, chosen]
        pose = np.broadcast_to(number, chosen.shape)[chosen]
        yield x, z, pose, groups[pose], z - on_target[1, 0, chosen]


def plot_points(found: Calibration) -> plt.Figure:
    """How well points are known over the scanner's field of view, around those seen."""
    seen = points_seen(found.solution)
    middle, size = (seen.max(1) + seen.min(1)) / 2, 0.75 * np.ptp(seen, axis=1)
    x, z = (m + s * np.linspace(-1, 1, 40) for m, s in zip(middle, size, strict=True))
    sd = np.linalg.norm(found.point_sd_mm(*np.meshgrid(x, z)), axis=-1)
    title = f"A point in the {found.frame} frame is known to … mm"
    figure, (axes,) = panels(1, 1, 4.0, title)
    levels = MaxNLocator(4, steps=(1, 2, 5, 10))
    lines = axes.contour(x, z, sd, locator=levels, colors=BLUE, linewidths=1)
    axes.clabel(lines, fmt="%.3g", fontsize=8)
    some = seen[:, :: 1 + seen.shape[1] // 2000]
    axes.plot(*some, ".", ms=1.5, color="0.6", label="seen")
    axes.set(xlabel="x [mm]", ylabel="z [mm]", ylim=(z[-1], z[0]))
    key(figure, axes)
    return figure


def plot_directions(found: Calibration) -> plt.Figure:
    """How well each of the six directions of the sensor's pose is known, worst first.

    The scale counts 10 mm and 5° alike, as a measurement by hand is known.
    """
    solution, known = found.solution, found.solution.observability
    title = f"The weakest direction of the sensor's pose is {known.status}"
    figure, (axes,) = panels(1, 1, 4.8, title)
    colours = np.select([known.sd >= 1, known.sd >= WEAK], [RED, ORANGE], GREEN)
    low = min(known.sd[-1] / 3, 0.01)
    axes.barh(range(6), np.minimum(known.sd, 10), 0.3, color=colours)
    for y, (sd, direction) in enumerate(zip(known.sd, known.directions, strict=True)):
        size = size_direction(sd, direction) if sd < 1 else "unobservable"
        name = name_direction(direction, solution.rotation, found.frame, axes_to_jog)
        text = fill(f"{name}: {size}", 80)
        axes.text(1.1 * low, y - 0.2, text, fontsize=8, va="bottom")
    axes.set(xscale="log", xlim=(low, 10), ylim=(5.5, -0.8), yticks=[])
    axes.set_xlabel("standard deviation")
    axes.xaxis.set_major_formatter(lambda sd, _: f"{10 * sd:g} mm\n{5 * sd:g}°")
    return figure


def axes_to_jog(vector: ndarray, frame: str) -> str:
    """A direction by the axes along and about which a robot is jogged, those with the
    larger shares first: "the flange's y, -z".
    """
    shares = vector / np.linalg.norm(vector)
    order = np.argsort(-np.abs(shares))
    signs = np.where(shares * shares[order[0]] < 0, "-", "")
    axes = [signs[i] + "xyz"[i] for i in order if abs(shares[i]) > 0.4]
    return f"the {frame}'s {', '.join(axes)}"


def save_plan(plan: Plan, path: Path) -> None:
    """Write the picture of a plan as a PNG file: the sensor's way, some fields of view,
    and the target; eye-to-hand, in the frame of the flange.
    """
    use_style()
    model, predicted = plan.model, plan.predicted
    figure, axes = plt.subplots(figsize=(7, 5.5), subplot_kw={"projection": "3d"})
    R_view, T_view = model.planes(plan.R, plan.T)

    def placed(points: ndarray) -> ndarray:
        """Points in the scan planes (P | 1, n, 2) where the sensor is."""
        return points @ R_view[..., ::2].mT + T_view[:, None]

    z = np.repeat([model.scanner.near, model.scanner.far], 2)
    x = model.scanner.half_width(z) * [-1, 1, 1, -1]
    views = placed(np.stack([x, z], axis=1))
    axes.plot(*T_view.T, color=BLUE, lw=0.8, alpha=0.6)
    dots = {"color": BLUE, "s": 8, "depthshade": False}
    axes.scatter(*T_view.T, label="sensor, on its way", **dots)
    few = spread(len(views), 5)
    size = 0.06 * np.ptp(np.vstack([*views, T_view]), axis=0).max()
    for k in few:
        draw_patch(axes, views[k], SKY, 0.12, "" if k else "field of view")
        draw_frame(axes, R_view[k], T_view[k], size)
    seen = placed(model.points_seen(R_view, T_view, 5)).reshape(-1, 3)
    target = draw_lines(axes, model.target.lines(seen), "black", "")
    frame = "flange" if model.to_hand else "base"
    in_frame(axes, frame, np.vstack([T_view, *views[few], target]))
    axes.computed_zorder = False
    axes.legend(loc="upper left", fontsize=8)
    count = f"{len(plan.T) // 2} sweeps" if plan.speed else f"{len(plan.T)} poses"
    axes.set_title(
        f"{count} over the {model.target.kind} (black): "
        f"{predicted.mm:.2g} mm and {predicted.deg:.2g}° predicted"
    )
    figure.savefig(path, dpi=150)
    plt.close(figure)
