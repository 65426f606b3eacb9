"""Pictures for the report, of a calibration's robot and profiles; and of a plan."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from mpl_toolkits.mplot3d import Axes3D
from numpy import ndarray

from profilecal.calibration.calibration import Calibration
from profilecal.calibration.points import points_seen
from profilecal.calibration.verify import target_by
from profilecal.geometry.observability import WEAK, name_direction, size_direction
from profilecal.geometry.poses import carry, homogeneous, in_base
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
    use_style,
)
from profilecal_tool.plan.design import Plan
from profilecal_tool.report.calibration import of_poses

WIDTH = 5.6  # inches, of a page's pictures
OF_PAGE = 20  # profiles
AS_IT_IS = {"parse_math": False}  # a user's text, where a $ is a $
DOTS = {"ls": "", "marker": ".", "ms": 2, "color": "0.55"}


def panels(
    rows: int, columns: int, height: float, title: str = "", **options: object
) -> tuple[plt.Figure, Sequence[Axes]]:
    """A figure as wide as the page of so many panels, row by row, each so many inches
    high; `options` as `plt.subplots` takes them.
    """
    use_style()
    size = WIDTH, rows * height
    figure, places = plt.subplots(rows, columns, figsize=size, squeeze=False, **options)
    figure.suptitle(title)
    return figure, places.ravel()


def in_space(title: str, frame: str) -> tuple[plt.Figure, Axes3D]:
    """A figure of one 3D plot, along the axes of a frame."""
    figure, (axes,) = panels(1, 1, 5.2, title, subplot_kw={"projection": "3d"})
    axes.set_box_aspect((1, 1, 1), zoom=0.88)  # room for the names
    for axis in "xyz":
        getattr(axes, f"set_{axis}label")(f"{frame} {axis} [mm]", labelpad=9)
    axes.locator_params(nbins=4)
    return figure, axes


def one_scale(axes: Axes3D) -> None:
    """Give a 3D plot the same scale along its axes, around all that is drawn."""
    axes.set_aspect("equal", adjustable="datalim")


def key(axes: Axes) -> None:
    """Draw a legend below the figure, each label once."""
    handles, labels = axes.get_legend_handles_labels()
    once = dict(zip(labels, handles, strict=True))
    axes.figure.legend(once.values(), once, loc="outside lower center", ncols=2)


def draw_scene(
    axes: Axes3D,
    sensors: Iterable[ndarray],
    xz: ndarray,
    lines: Sequence[ndarray],
    name: str,
) -> None:
    """Draw sensors at poses T (4, 4), each with a part of its scan plane, corners x and
    z (4, 2); and a target of this name as polylines (n, 3).
    """
    for T in sensors:
        corners = T[:3, 3] + xz @ T[:3, [0, 2]].T
        draw_patch(axes, corners, SKY, 0.15, "seen in the scan plane")
        draw_frame(axes, T[:3, :3], T[:3, 3], 0.2 * xz.max())
    for line in lines:
        axes.plot(*line.T, color="black", lw=1 if lines[1:] else 3, label=name)


def plot_robot(found: Calibration) -> plt.Figure:
    """The flange's poses, and where the calibration puts scan planes and targets, in
    the base frame.
    """
    positions = np.concatenate([scan.p_base_flange for scan in found.scans])
    title = f"Where the robot went: {len(positions)} poses"
    figure, axes = in_space(title, "base")
    axes.plot(*positions.T, **DOTS, label="flange")
    size = 0.08 * np.ptp(positions, axis=0).max() + 5
    for scan, observed in zip(found.scans, found.observed, strict=True):
        flange = scan.T_base_flange[:: 1 + len(scan.labels) // 20]
        for T in flange:
            draw_frame(axes, T[:3, :3], T[:3, 3], size)
        if found.is_known:
            draw_answer(axes, found.pose, observed, flange)
    one_scale(axes)
    key(axes)
    return figure


def draw_answer(
    axes: Axes3D, pose: ndarray, observed: Observations, flange: ndarray
) -> None:
    """Draw where a sensor pose (4, 4) has the sensor at some flange poses (n, 4, 4),
    and the target that was observed.
    """
    target, points, _ = target_by(pose, observed)
    lines = target.lines(points)
    x, z = np.nanpercentile(observed.points[0], [1, 99], axis=(0, 1)).T
    corners = np.stack([x[[0, 1, 1, 0]], z[[0, 0, 1, 1]]], axis=1)
    sensors = flange[::3] @ pose
    if observed.eye_to_hand:
        sensors = [pose]
        lines = [carry(T[:3, :3], T[:3, 3], line) for T in flange for line in lines]
    else:
        for way in np.stack([flange[::3, :3, 3], sensors[:, :3, 3]], axis=2):
            axes.plot(*way, "--", color="0.6", lw=0.8, label="to the sensor's origin")
    name = f"{observed.kind}, where the scans place it"
    draw_scene(axes, sensors, corners, lines, name)


def save_plan(plan: Plan, path: Path) -> None:
    """Write the picture of a plan as a PNG file: the sensor's way, some fields of view,
    and the target; eye-to-hand, in the frame of the flange.
    """
    model, predicted = plan.model, plan.predicted
    count = f"{len(plan.T) // 2} sweeps" if plan.speed else f"{len(plan.T)} poses"
    title = f"{count}: {predicted.mm:.2g} mm and {predicted.deg:.2g}° predicted"
    figure, axes = in_space(title, "flange" if model.to_hand else "base")
    R, T = model.planes(plan.R, plan.T)
    axes.plot(*T.T, ".-", color=BLUE, lw=0.8, label="sensor, on its way")
    z = np.repeat([model.scanner.near, model.scanner.far], 2)
    corners = np.stack([model.scanner.half_width(z) * [-1, 1, 1, -1], z], axis=1)
    views = homogeneous(R, T)[:: 1 + len(T) // 5]
    seen, _ = in_base(np.eye(4), model.points_seen(R, T, 5), R, T)
    draw_scene(axes, views, corners, model.target.lines(seen), model.target.kind)
    one_scale(axes)
    key(axes)
    figure.savefig(path, dpi=150)
    plt.close(figure)


def plot_profiles(
    scan: Scan, rejected: Sequence[str] = (), most: int = 120
) -> Iterator[plt.Figure]:
    """Profiles of a scan with what was found in them, 20 to a figure, all at one scale,
    z downwards. The points that a feature rests on are blue.

    Of more than `most` they are as many, evenly spread. There are no figures where
    there are no raw profiles. `rejected`: labels of the poses that the calibration
    rejects.
    """
    if scan.measured != "profiles":
        return
    features = scan.target.find(scan.values, *scan.sizes.values())
    step = -(-len(features) // most)
    words = f" (one in {step} is drawn)" if step > 1 else ""
    drawn = range(0, len(features), step)
    for first in range(0, len(drawn), OF_PAGE):
        page = drawn[first : first + OF_PAGE]
        count = sum(features[i].found for i in page)
        title = (
            f"Profiles {page[0] + 1} to {page[-1] + 1} of {len(features)}: "
            f"{count} features found; x and z in mm{words}"
        )
        rows = -(-len(page) // 4)
        figure, places = panels(rows, 4, 1.4, title, sharex=True, sharey=True)
        places[0].invert_yaxis()
        for axes, i in zip(places, page, strict=False):
            profile, feature, label = scan.values[i], features[i], scan.labels[i]
            axes.plot(*profile.T, **DOTS)
            axes.plot(*profile[feature.used].T, ".", ms=1.5, color=BLUE)
            if scan.target.points:
                axes.plot(*feature.points.T, "o", ms=5, mfc="none", mec=RED)
            note = "rejected" * (label in rejected) if feature.found else "not found"
            about = {"color": RED if note else "black", "fontsize": 8} | AS_IT_IS
            axes.set_title(f"{label[:10]} {note}", **about)
        for axes in places[len(page) :]:
            axes.axis("off")
        yield figure


def plot_residuals(found: Calibration) -> plt.Figure:
    """Each pose's residual over the noise, and what chance explains, a panel a scan.

    Residuals are shaded by orientation; those of rejected poses are red, and may end
    above.
    """
    figure, rows = panels(len(found.scans), 1, 3.2)
    every = zip(rows, found.scans, found.seen, *of_poses(found), strict=True)
    for axes, scan, seen, size, bad, limit in every:
        by_group = np.where(scan.group[seen] % 2, SKY, BLUE)
        width = 300 / len(seen)
        axes.vlines(seen, 0, size, np.where(bad, RED, by_group), lw=width)
        axes.plot(seen, limit, "--", color=RED, label="limit of chance")
        ticks = seen[:: 1 + len(seen) // 7]
        names = [scan.labels[i].partition("@")[0][:8] for i in ticks]  # or the sweeps'
        axes.set_xticks(ticks, names, **AS_IT_IS)
        highest = 1.15 * max(*size[~bad], *limit)
        axes.set(xlabel="pose", ylabel="residual / noise", ylim=(0, highest))
        inside = np.count_nonzero((size <= limit) & ~bad)
        title = f"chance explains {inside} of {len(seen)} residuals"
        axes.set_title(f"{scan.title or scan.kind}:\n{title}", **AS_IT_IS)
    key(rows[-1])
    return figure


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
    title = "By chance one mean (orange) in 20 leaves the band: of 32, up to 4"
    figure, places = panels(2, 2, 2.2, title)
    draw_patterns(places, found)
    for axes, means in zip(places, PATTERNS.values(), strict=True):
        axes.set_title(means, fontsize=8)
    places[0].set_ylabel("off in z [mm]")
    return figure


def draw_patterns(places: Sequence[Axes], found: Calibration) -> None:
    """Draw how far points are off in z over each of PATTERNS: the means of eight parts,
    and the band in which chance puts 95 % of them, by the scatter of the orientations
    within the parts: the profiles of one, or of a sweep, share errors of the robot.
    """
    off = offsets(found)
    some = off[:: 1 + len(off) // 1500]
    for axes, name in zip(places, PATTERNS, strict=True):
        part = pd.cut(off[name], 8)
        groups = off.groupby([part, "orientation"], observed=True)[[name, "off"]].mean()
        parts = groups.groupby(level=0, observed=True)
        means = parts.mean()
        scatter = groups["off"] - parts["off"].transform("mean")
        chance = 1.96 * scatter.std(ddof=len(means)) / np.sqrt(parts.size())
        axes.fill_between(means[name], -chance, chance, color=SKY, alpha=0.4, lw=0)
        axes.plot(some[name], some["off"], **DOTS)
        axes.plot(means[name], means["off"], "o-", ms=3, color=RED)
        axes.set_xlabel(name)
        axes.tick_params(labelsize=8)  # four fit beside each other


def offsets(found: Calibration) -> pd.DataFrame:
    """Of each point kept, PATTERNS, and how far it is "off" the target in z, less the
    mean of all.
    """
    solution = found.solution
    problem, state = solution.problem, solution.state
    group = problem.groups.group
    numbers = problem.split(np.arange(len(group)))
    every = zip(problem.terms, state.placements, numbers, solution.kept, strict=True)
    rows = []
    for term, placement, number, kept in every:
        on_target = term.on_target(term.linearise(state, placement)).seen
        chosen = term.present[0] & kept
        x, z = term.seen[:, 0, chosen]
        pose = np.broadcast_to(number, chosen.shape)[chosen]
        off = z - on_target[1, 0, chosen]
        rows.append(np.c_[x, z, pose, group[pose], off])
    table = pd.DataFrame(np.concatenate(rows), columns=[*PATTERNS, "off"])
    table["off"] -= table["off"].mean()  # a scale of z that is put back lifts all alike
    return table


def plot_points(found: Calibration) -> plt.Figure:
    """How well points are known over the scanner's field of view, around those seen."""
    seen = points_seen(found.solution)
    middle, size = (seen.max(1) + seen.min(1)) / 2, 0.75 * np.ptp(seen, axis=1)
    x, z = np.linspace(middle - size, middle + size, 40).T
    sd = np.linalg.norm(found.point_sd_mm(*np.meshgrid(x, z)), axis=-1)
    figure, (axes,) = panels(1, 1, 4.0, "A point is known to … mm")
    axes.clabel(axes.contour(x, z, sd, 4, colors=BLUE), fmt="%.4g")
    axes.use_sticky_edges = False  # a margin, in which labels end
    axes.plot(*seen[:, :: 1 + seen.shape[1] // 2000], **DOTS, label="seen")
    axes.set(xlabel="x [mm]", ylabel="z [mm]")
    axes.invert_yaxis()
    key(axes)
    return figure


def plot_directions(found: Calibration) -> plt.Figure:
    """How well each of the six directions of the sensor's pose is known, worst first.

    The scale counts 10 mm and 5° alike, as a measurement by hand is known.
    """
    solution, known = found.solution, found.solution.observability
    in_frame = f" in the {found.frame}'s frame"
    title = f"The weakest direction of the sensor's pose is {known.status}"
    figure, (axes,) = panels(1, 1, 4.8, title)
    colours = np.select([known.sd >= 1, known.sd >= WEAK], [RED, ORANGE], GREEN)
    low = min(known.sd[-1] / 3, 0.01)
    axes.barh(range(6), known.sd, 0.3, color=colours)
    for y, (sd, direction) in enumerate(zip(known.sd, known.directions, strict=True)):
        size = size_direction(sd, direction) if sd < 1 else "unobservable"
        name = name_direction(direction, solution.rotation, found.frame)
        text = f"{name.replace(in_frame, '')}:\n{size}"
        axes.text(1.1 * low, y - 0.2, text, fontsize=8, va="bottom")
    axes.set(xscale="log", xlim=(low, 10), ylim=(5.5, -0.8), yticks=[])
    axes.set_xlabel(f"standard deviation, near these poses; axes{in_frame}")
    axes.xaxis.set_major_formatter(lambda sd, _: f"{10 * sd:g} mm\n{5 * sd:g}°")
    return figure
