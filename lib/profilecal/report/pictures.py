"""What a calibration looks like: its robot, its residuals, its profiles. Functions take a `calibrate.Calibration`."""

import matplotlib.pyplot as plt
import numpy as np

from profilecal.geometry.poses import angle_between, carry, circle_around, nearest_rotation
from profilecal.joint.observability import BY_HAND_DEG, BY_HAND_MM, WEAK, size_direction
from profilecal.report.calibration import chance_limits, features_of, field_of_view
from profilecal.report.figures import (
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    RED,
    SKY,
    YELLOW,
    draw_frame,
    draw_patch,
    draw_scan,
    equal_axes,
)

FRAMES_DRAWN, SCANS_DRAWN = 24, 8  # flange frames and scan planes in a picture
SCAN_COLOURS = ("black", PURPLE, YELLOW)
TO_SENSOR = "from the flange to the sensor's origin"
PROFILES_DRAWN = 20  # profiles in one figure, so that figures fit on a page


def plot_robot(found) -> plt.Figure:
    """The flange's poses, the scan planes and the targets where the calibration puts them, in the base frame."""
    figure = plt.figure(figsize=(5.6, 5.2))
    axes = figure.add_subplot(projection="3d")
    known, on_flange = found.status != "unobservable", found.scans[0].mount == "eye-in-hand"
    origins = np.concatenate([scan.T_base_flange for scan in found.scans])
    size = 0.08 * np.ptp(origins, axis=0).max() + 5
    drawn = [origins]
    if known and not on_flange:
        s = found.solution
        for observed in found.observed:
            corners = draw_seen(axes, observed, s.rotation, s.translation)
            drawn += [corners, s.translation[None]]
        draw_frame(axes, s.rotation, s.translation, 0.35 * np.ptp(corners, axis=0).max())
    for k, (scan, observed) in enumerate(zip(found.scans, found.observed, strict=True)):
        R, T, colour = scan.R_base_flange, scan.T_base_flange, SCAN_COLOURS[k % 3]
        few = np.unique(np.linspace(0, len(T) - 1, max(1, FRAMES_DRAWN // len(found.scans))).round().astype(int))
        axes.scatter(*T.T, color="0.35", s=6, depthshade=False, label=f"flange, {len(origins)} poses")
        for i in few:
            draw_frame(axes, R[i], T[i], size)
        if not known:
            continue
        lines = target_lines(found.solution.placements[k], found.solution, observed)
        if on_flange:
            for i in few[:: -(-len(few) * len(found.scans) // SCANS_DRAWN)]:
                rotation, origin = R[i] @ found.solution.rotation, T[i] + R[i] @ found.solution.translation
                axes.plot(*np.stack([T[i], origin]).T, color="0.6", lw=0.8, ls="--", label=TO_SENSOR)
                drawn += [draw_seen(axes, observed, rotation, origin), origin[None]]
            drawn.append(draw_lines(axes, lines, colour, f"{scan.kind}, where the scans place it"))
        else:
            for i in few:
                moved = [line @ R[i].T + T[i] for line in lines]
                drawn.append(draw_lines(axes, moved, colour, f"{scan.kind}, carried by the flange", width=0.8))
    equal_axes(axes, np.concatenate(drawn))
    axes.set(xlabel="base x [mm]", ylabel="base y [mm]", zlabel="base z [mm]")
    axes.locator_params(nbins=5)
    seen = "scans and targets" if len(found.scans) > 1 else f"scans and {found.scans[0].kind}"
    figure.suptitle(f"Where the calibration places {seen}" if known else "Where the robot went")
    handles, labels = axes.get_legend_handles_labels()
    once = dict(zip(labels, handles, strict=True))
    figure.legend(once.values(), once, loc="outside lower center", ncols=2)
    return figure


def draw_seen(axes, observed, rotation, origin) -> np.ndarray:
    """Draw the part of the scan plane in which nearly all was seen, by a sensor there; return its corners (4, 3)."""
    x, z = np.nanpercentile(np.asarray(observed.points)[0].reshape(-1, 2), [1, 99], axis=0).T
    corners = origin + np.stack([x[[0, 1, 1, 0]], np.zeros(4), z[[0, 0, 1, 1]]], axis=-1) @ rotation.T
    draw_patch(axes, corners, SKY, label="seen in the scan plane")
    return corners


def draw_lines(axes, lines, colour: str, label: str, width: float = 3.0) -> np.ndarray:
    """Draw polylines (n, 3) in a 3D plot; return their points."""
    for line in lines:
        axes.plot(*line.T, color=colour, lw=width if len(lines) == 1 else 1, label=label)
    return np.concatenate(lines)


def target_lines(target, solution, observed) -> list[np.ndarray]:
    """A target as polylines (n, 3), as far as it was seen."""
    x, z = np.moveaxis(np.asarray(observed.points)[0], -1, 0)
    in_flange = np.stack([x, np.zeros_like(x), z], axis=-1) @ solution.rotation.T + solution.translation
    in_base = carry(observed.R_flange[0][:, None], observed.T_flange[0][:, None], in_flange)
    return target.lines(in_base.reshape(-1, 3))


def plot_residuals(found) -> plt.Figure | None:
    """Each pose's residual over the noise, by scan, with the means of rotation groups and the poses rejected."""
    if not found.solution:
        return None
    figure, rows = plt.subplots(len(found.scans), figsize=(5.6, 0.6 + 2.5 * len(found.scans)), squeeze=False)
    parts = zip(rows[:, 0], found.scans, found.seen, found.solution.normalised, found.solution.rejected, strict=True)
    good = 0
    for (axes, scan, seen, size, bad), limit in zip(parts, chance_limits(found), strict=True):
        group = scan.group[seen] if scan.group is not None else np.arange(len(seen))
        top = 1.15 * max(np.append(size[~bad], limit))
        even = np.unique(group, return_inverse=True)[1] % 2 == 0
        axes.bar(seen[~bad], size[~bad], color=np.where(even[~bad], BLUE, SKY), width=0.8)
        if any(map(np.any, found.solution.rejected)):
            where = np.minimum(size[bad], 0.97 * top)
            axes.scatter(seen[bad], where, marker="x", color=RED, zorder=3, label="rejected")
        for g in np.unique(group):
            kept = (group == g) & ~bad
            if kept.sum() > 1:
                mean = np.sqrt(np.mean(size[kept] ** 2))
                axes.plot([seen[kept][0] - 0.4, seen[kept][-1] + 0.4], [mean, mean], color="black", lw=1.5)
        axes.plot(seen, limit, color=RED, lw=1, ls="--", label="limit of chance")
        axes.axhline(1, color="0.5", lw=0.8, ls=":")
        axes.plot([], [], color="black", lw=1.5, label="rms of a group")
        axes.set(xlabel="pose", ylabel="residual / noise", ylim=(0, top), title=scan.title if len(rows) > 1 else "")
        label_poses(axes, seen, [scan.labels[i] for i in seen])
        good += np.count_nonzero((size <= limit) & ~bad)
    figure.suptitle(f"{good} of {sum(map(len, found.seen))} residuals are no larger than chance explains")
    figure.legend(*rows[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def plot_left_out(left) -> plt.Figure | None:
    """How well each orientation is predicted by the others (`leave_out.LeftOut`), and how well to expect it."""
    shown = np.flatnonzero(np.isfinite(left.rms_mm))
    if not len(shown):
        return None
    figure, axes = plt.subplots(figsize=(5.6, 2.6))
    colours = np.where(left.doubted[shown], RED, BLUE)
    axes.bar(np.arange(len(shown)), left.rms_mm[shown], color=colours, width=0.75, label="found")
    axes.scatter(np.arange(len(shown)), left.expected_mm[shown], marker="_", s=120, color="black", label="expected")
    label_poses(axes, np.arange(len(shown)), [left.poses[g][0] for g in shown])
    axes.set(xlabel="orientation left out, by its first pose", ylabel="predicted to, rms [mm]")
    good = np.count_nonzero(~left.doubted[shown])
    figure.suptitle(f"{good} of {len(shown)} orientations fit the others")
    figure.legend(loc="outside lower center", ncols=2)
    return figure


def label_poses(axes, places, labels) -> None:
    """Write the poses' labels below an axis, as many as fit."""
    names = [shorten(label, 8) for label in labels]
    every = -(-len(names) * max(map(len, names)) // 40)
    axes.set_xticks(places[::every], names[::every])


def shorten(text: str, length: int) -> str:
    """The text, cut where it is longer."""
    return text if len(text) <= length else text[: length - 1] + "…"


def plot_view(found) -> plt.Figure:
    """What was seen of the targets, in the scan plane, and the field of view, as far as raw profiles show it."""
    figure, axes = plt.subplots(figsize=(5.6, 4.2))
    field, title = field_of_view(found.scans), "Where the features lie in the scan plane"
    if field is not None:
        seen = np.concatenate([np.asarray(o.points).reshape(-1, 2) for o in found.observed])
        across, deep = (np.nanmax(seen, axis=0) - np.nanmin(seen, axis=0)) / np.ptp(field, axis=0)
        title = f"Features span {100 * across:.0f} % of the width, {100 * deep:.0f} % of the height"
        axes.fill(*field.T, color="0.92", label="field of view, as far as the profiles reach")
    for k, (scan, o) in enumerate(zip(found.scans, found.observed, strict=True)):
        colour, points = (BLUE, GREEN, ORANGE, PURPLE)[k % 4], np.asarray(o.points)[0]
        name = f"{scan.title}: features" if len(found.scans) > 1 else "features"
        if o.target.points == 2:
            lines = np.concatenate([points, np.full_like(points[:, :1], np.nan)], axis=1).reshape(-1, 2)
            axes.plot(*lines.T, color=colour, lw=0.8, alpha=0.6, label=name)
        elif scan.measured == "arcs":
            for x, z, r in (scan.values[i][0] for i in found.seen[k]):
                angle = np.radians(np.linspace(-60, 60, 40))
                axes.plot(x + r * np.sin(angle), z - r * np.cos(angle), color=colour, lw=0.8, alpha=0.6, label=name)
                name = ""
        else:
            axes.scatter(*points.reshape(-1, 2).T, s=8 if o.target.points else 1, color=colour, label=name, alpha=0.7)
    axes.set(xlabel="sensor x [mm]", ylabel="sensor z [mm]", aspect="equal")
    axes.invert_yaxis()
    figure.suptitle(title)
    figure.legend(loc="outside lower center", ncols=2)
    return figure


def plot_profiles(scan, rejected=()) -> list[plt.Figure]:
    """Every profile of a scan with what was found in it, PROFILES_DRAWN to a figure, all at one scale.

    `rejected`: labels of the poses that the calibration rejects. No figures where the scan holds no raw profiles.
    """
    features = features_of(scan)
    if not features:
        return []
    valid = [values[np.isfinite(values).all(axis=1)] for values in scan.values]
    width, height = 1.2 * np.percentile([np.ptp(values, axis=0) for values in valid if len(values)], 90, axis=0)
    cell = np.array([width, np.clip(height, 0.4 * width, 0.75 * width)])
    figures = []
    for first in range(0, len(features), PROFILES_DRAWN):
        page = range(first, min(first + PROFILES_DRAWN, len(features)))
        figures.append(profile_page(scan, features, page, cell, set(rejected)))
    return figures


def profile_page(scan, features, page, cell, rejected, columns: int = 4) -> plt.Figure:
    """One figure of `plot_profiles`: all in one set of axes, each profile moved to its place, which draws fast."""
    step, rows = cell * [1.05, -1.35], -(-len(page) // columns)
    figure, axes = plt.subplots(figsize=(5.6, 5.6 / columns * (rows + 0.2) * step[1] / -step[0]))
    for k, i in enumerate(page):
        feature, corner = features[i], step * [k % columns, k // columns]
        note = "not found" if feature.reason else "rejected" if scan.labels[i] in rejected else ""
        axes.add_patch(plt.Rectangle(corner - cell / 2, *cell, fill=False, ec="0.8", lw=0.6))
        text = f"{shorten(scan.labels[i], 10)} {note}".strip()
        axes.text(corner[0], corner[1] + 0.54 * cell[1], text, color=RED if note else "0.2", ha="center", fontsize=8)
        draw_profile(axes, scan, scan.values[i], feature, corner, cell)
    bar, left = 10 ** np.floor(np.log10(cell[0] / 2)), -cell[0] / 2
    bottom = (rows - 0.5) * step[1] + 0.05 * cell[1]
    axes.plot([left, left + bar], [bottom] * 2, color="black", lw=2)
    axes.text(left + 1.15 * bar, bottom, f"{bar:g} mm", va="center", fontsize=8)
    axes.set(
        aspect="equal",
        xlim=(1.02 * left, step[0] * (columns - 1) - 1.02 * left),
        ylim=(bottom - 0.1 * cell[1], 0.8 * cell[1]),
    )
    axes.axis("off")
    there = sum(features[i].found for i in page)
    figure.suptitle(f"Profiles {page[0] + 1} to {page[-1] + 1} of {len(features)}: {there} features found")
    return figure


def draw_profile(axes, scan, values, feature, corner, cell) -> None:
    """One profile, z downwards, within a cell around `corner`: the points that its feature rests on in blue."""
    there = np.isfinite(values).all(axis=1)
    if not there.any():
        return
    used = np.asarray(feature.used, dtype=bool) & there
    shown = values[used] if used.any() else values[there]
    middle = (shown.min(axis=0) + shown.max(axis=0)) / 2
    inside = there & (np.abs(values - middle) < cell / 2).all(axis=1)
    for points, colour in ((values[inside & ~used], "0.6"), (values[inside & used], BLUE)):
        axes.plot(*((points - middle) * [1, -1] + corner).T, ".", ms=1.2, color=colour, rasterized=True)
    if feature.found and scan.target.points:
        axes.plot(*((feature.points - middle) * [1, -1] + corner).T, "o", ms=5, mfc="none", mec=RED, mew=1.3)


def plot_directions(found) -> plt.Figure | None:
    """The direction in which the sensor's pose is known worst, drawn at the sensor, and all six on one scale."""
    if not found.solution:
        return None
    s = found.solution.observability
    figure = plt.figure(figsize=(5.6, 6.0))
    grid = figure.add_gridspec(2, 1, height_ratios=(1.2, 1))
    view, scale = figure.add_subplot(grid[0], projection="3d"), figure.add_subplot(grid[1])
    draw_frame(view, np.eye(3), np.zeros(3), 0.5)
    for axis, name in zip(0.6 * np.eye(3), "xyz", strict=True):
        view.text(*axis, name, ha="center", va="center")
    draw_scan(view, np.eye(3), np.zeros(3), 1.1, SKY, "scan plane")
    draw_direction(view, s.directions[0])
    equal_axes(view, np.array([[-0.8, -0.8, -0.6], [0.8, 0.8, 1.0]]))
    view.set_box_aspect((1, 1, 1), zoom=1.25)
    view.set_axis_off()
    view.view_init(elev=-155, azim=-60)
    view.legend(loc="upper left", fontsize=9)

    sd, low = np.minimum(s.sd, 30), 10 ** np.floor(np.log10(min(s.sd[-1], 0.01)))
    for start, end, colour in ((low, WEAK, GREEN), (WEAK, 1, ORANGE), (1, 100, RED)):
        scale.axvspan(start, end, color=colour, alpha=0.15, lw=0)
    scale.barh(np.arange(1, 7), sd, color=[RED if v >= 1 else ORANGE if v >= WEAK else GREEN for v in s.sd], height=0.6)
    scale.set(xscale="log", xlim=(low, 50), ylim=(6.6, 0.0), yticks=range(1, 7), ylabel="direction, worst first")
    ticks = [v for v in (0.001, 0.01, 0.1, 1, 10) if v >= low]
    scale.set_xticks(ticks, [f"{BY_HAND_MM * v:g} mm\n{BY_HAND_DEG * v:g}°" for v in ticks])
    for place, text in ((np.sqrt(low * WEAK), "good"), (np.sqrt(WEAK), "weak"), (np.sqrt(50), "unknown")):
        scale.text(place, 0.3, text, ha="center", va="center", fontsize=9)
    scale.set_xlabel("standard deviation")
    name = "good" if s.sd[0] < WEAK else "weak" if s.sd[0] < 1 else "unknown"
    size = f": {size_direction(s.sd[0], s.directions[0])}" if s.sd[0] < 1 else ""
    figure.suptitle(f"The weakest direction is {name}{size}")
    return figure


def draw_direction(axes, direction) -> None:
    """A direction (6,) of a pose in a 3D plot: a straight arrow for its shift, a bent one for its turn."""
    shift, turn = direction[:3], direction[3:]
    if shift @ shift > 0.2:
        axes.quiver(0, 0, 0, *(0.8 * shift), color="black", lw=2.5, label="shift")
    if turn @ turn > 0.2:
        axis = turn / np.linalg.norm(turn)
        axes.plot(*np.outer(axis, [-0.9, 0.9]), color=PURPLE, lw=1, ls="--")
        around = circle_around(0.75 * axis, axis, 0.2)[:70]
        axes.plot(*around.T, color=PURPLE, lw=2.5, label="turn")
        axes.quiver(*around[-1], *(3 * (around[-1] - around[-2])), color=PURPLE, lw=2.5, arrow_length_ratio=2)


def plot_setting(found) -> plt.Figure:
    """Where targets and scanner are, from results alone: flange, sensor frame and scan plane in the middle of each
    scan's poses, twice the standard deviation of its positions as a cross, and how far it turns. No pose is drawn."""
    figure = plt.figure(figsize=(7, 6))
    axes, drawn, turned_by, s = figure.add_subplot(projection="3d"), [], [], found.solution
    parts = zip(found.scans, found.observed, s.placements, (BLUE, GREEN, ORANGE, PURPLE), strict=False)
    for scan, observed, placement, colour in parts:
        rotation = observed.R_flange[0] @ s.rotation
        origins = observed.T_flange[0] + observed.R_flange[0] @ s.translation
        middle, turned = origins.mean(axis=0), nearest_rotation(rotation.mean(axis=0))
        turns = np.sqrt(np.mean(np.degrees(angle_between(turned, rotation)) ** 2))
        turned_by.append(f"{turns:.0f}° over the {scan.kind}")
        drawn.append(draw_lines(axes, target_lines(placement, s, observed), colour, scan.kind))
        corners = draw_seen(axes, observed, turned, middle)
        flange = middle - turned @ s.rotation.T @ s.translation
        axes.plot(*np.stack([flange, middle]).T, color="0.4", lw=1.5, ls="--", label=TO_SENSOR)
        draw_frame(axes, turned @ s.rotation.T, flange, 50)
        draw_frame(axes, turned, middle, 50)
        values, directions = np.linalg.eigh(np.cov(origins.T))
        for value, direction in zip(values, directions.T, strict=True):
            ends = middle + np.outer([-2, 2], np.sqrt(value) * direction)
            axes.plot(*ends.T, color="black", lw=1, label="± 2 sd of the positions")
        drawn += [corners, flange[None]]
    equal_axes(axes, np.concatenate(drawn))
    axes.set(xlabel="base x [mm]", ylabel="base y [mm]", zlabel="base z [mm]")
    axes.set_box_aspect((1, 1, 1), zoom=1.1)
    lever = np.linalg.norm(s.translation)
    figure.suptitle(f"The sensor's origin is {lever:.0f} mm from the flange; rms turns: {', '.join(turned_by)}")
    axes.locator_params(nbins=5)
    handles, labels = axes.get_legend_handles_labels()
    once = dict(zip(labels, handles, strict=True))
    figure.legend(once.values(), once, loc="outside lower center", ncols=2)
    return figure
