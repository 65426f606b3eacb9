"""Pictures of a calibration, for the report: its robot and its profiles; and of a plan."""

import matplotlib.pyplot as plt
import numpy as np

from profilecal.geometry.poses import carry
from profilecal.targets.target import find_features
from profilecal_pages.figures import (
    BLUE,
    RED,
    SKY,
    draw_frame,
    draw_patch,
    equal_axes,
    use_style,
)
from profilecal_tool.plan.design import Plan


def plot_robot(found) -> plt.Figure:
    """The flange's poses, the scan planes and the targets where the calibration puts
    them, in the base frame.
    """
    figure = plt.figure(figsize=(5.6, 5.2))
    axes, s = figure.add_subplot(projection="3d"), found.solution
    drawn = [scan.p_base_flange for scan in found.scans]
    size = 0.08 * np.ptp(np.concatenate(drawn), axis=0).max() + 5
    for k, (scan, observed) in enumerate(zip(found.scans, found.observed, strict=True)):
        R, T = scan.R_base_flange, scan.p_base_flange
        few = np.unique(
            np.linspace(0, len(T) - 1, max(1, 24 // len(found.scans)))
            .round()
            .astype(int)
        )
        axes.scatter(*T.T, color="0.35", s=6, depthshade=False, label="flange")
        for i in few:
            draw_frame(axes, R[i], T[i], size)
        if found.status == "unobservable":
            continue
        lines = target_lines(s.placements[k], s, observed)
        if found.frame == "flange":
            for i in few[::3]:
                origin = T[i] + R[i] @ s.translation
                axes.plot(
                    *np.stack([T[i], origin]).T,
                    color="0.6",
                    lw=0.8,
                    ls="--",
                    label="to the sensor's origin",
                )
                drawn += [
                    draw_seen(axes, observed, R[i] @ s.rotation, origin),
                    origin[None],
                ]
        else:
            draw_frame(axes, s.rotation, s.translation, 3 * size)
            drawn += [
                draw_seen(axes, observed, s.rotation, s.translation),
                s.translation[None],
            ]
            lines = [line @ R[i].T + T[i] for i in few for line in lines]
        drawn.append(
            draw_lines(axes, lines, "black", f"{scan.kind}, where the scans place it")
        )
    equal_axes(axes, np.concatenate(drawn))
    axes.set(xlabel="base x [mm]", ylabel="base y [mm]", zlabel="base z [mm]")
    axes.locator_params(nbins=5)
    figure.suptitle(
        f"Where the robot went: {sum(len(scan.labels) for scan in found.scans)} poses"
    )
    key(figure, axes)
    return figure


def key(figure, axes) -> None:
    """A legend below the figure, each label once."""
    handles, labels = axes.get_legend_handles_labels()
    once = dict(zip(labels, handles, strict=True))
    figure.legend(once.values(), once, loc="outside lower center", ncols=2)


def draw_seen(axes, observed, rotation, origin) -> np.ndarray:
    """Draw the part of the scan plane in which nearly all was seen, by a sensor there;
    return its corners (4, 3).
    """
    x, z = np.nanpercentile(observed.points[0].reshape(-1, 2), [1, 99], axis=0).T
    corners = (
        origin
        + np.stack([x[[0, 1, 1, 0]], z[[0, 0, 1, 1]]], axis=-1) @ rotation[:, ::2].T
    )
    draw_patch(axes, corners, SKY, label="seen in the scan plane")
    return corners


def draw_lines(axes, lines, colour: str, label: str) -> np.ndarray:
    """Draw polylines (n, 3) in a 3D plot; return their points."""
    for line in lines:
        axes.plot(*line.T, color=colour, lw=3 if len(lines) == 1 else 1, label=label)
    return np.concatenate(lines)


def target_lines(target, solution, observed) -> list[np.ndarray]:
    """A target as polylines (n, 3), as far as it was seen."""
    in_flange = observed.points[0] @ solution.rotation[:, ::2].T + solution.translation
    in_base = carry(
        observed.R_flange[0][:, None], observed.T_flange[0][:, None], in_flange
    )
    return target.lines(in_base.reshape(-1, 3))


def plot_profiles(scan, rejected=()) -> list[plt.Figure]:
    """Every profile of a scan with what was found in it, 20 to a figure, all at one
    scale; none where there are no raw ones. `rejected`: labels of the poses that the
    calibration rejects.
    """
    if scan.measured != "profiles":
        return []
    features = find_features(scan.target, scan.values, scan.sizes)
    valid = [values[np.isfinite(values).all(axis=1)] for values in scan.values]
    width, height = 1.2 * np.percentile(
        [np.ptp(values, axis=0) for values in valid if len(values)], 90, axis=0
    )
    cell = np.array([width, np.clip(height, 0.4 * width, 0.75 * width)])
    pages = [range(i, min(i + 20, len(features))) for i in range(0, len(features), 20)]
    return [profile_page(scan, features, page, cell, set(rejected)) for page in pages]


def profile_page(scan, features, page, cell, rejected) -> plt.Figure:
    """One figure of `plot_profiles`: all in one set of axes, each profile moved to its
    place, which draws fast.
    """
    columns, step = 4, cell * [1.05, -1.35]
    rows = -(-len(page) // columns)
    figure, axes = plt.subplots(
        figsize=(5.6, 5.6 / columns * (rows + 0.2) * step[1] / -step[0])
    )
    for k, i in enumerate(page):
        feature, corner = features[i], step * [k % columns, k // columns]
        note = (
            "not found"
            if feature.reason
            else "rejected"
            if scan.labels[i] in rejected
            else ""
        )
        axes.add_patch(
            plt.Rectangle(corner - cell / 2, *cell, fill=False, ec="0.8", lw=0.6)
        )
        text = f"{scan.labels[i][:10]} {note}".strip()
        axes.text(
            corner[0],
            corner[1] + 0.54 * cell[1],
            text,
            color=RED if note else "0.2",
            ha="center",
            fontsize=8,
        )
        draw_profile(axes, scan, scan.values[i], feature, corner, cell)
    left, bottom = -0.51 * cell[0], (rows - 0.5) * step[1]
    axes.set(
        aspect="equal",
        xlim=(left, step[0] * (columns - 1) - left),
        ylim=(bottom, 0.8 * cell[1]),
    )
    axes.axis("off")
    found = f"{sum(features[i].found for i in page)} features found; a frame is {cell[0]:.0f} mm wide"
    figure.suptitle(
        f"Profiles {page[0] + 1} to {page[-1] + 1} of {len(features)}: {found}"
    )
    return figure


def draw_profile(axes, scan, values, feature, corner, cell) -> None:
    """One profile, z downwards, within a cell around `corner`: the points that its
    feature rests on in blue.
    """
    there = np.isfinite(values).all(axis=1)
    if not there.any():
        return
    used = there & np.isin(np.arange(len(values)), feature.used)
    shown = values[used] if used.any() else values[there]
    middle = (shown.min(axis=0) + shown.max(axis=0)) / 2
    inside = there & (np.abs(values - middle) < cell / 2).all(axis=1)
    for points, colour in (
        (values[inside & ~used], "0.6"),
        (values[inside & used], BLUE),
    ):
        axes.plot(
            *((points - middle) * [1, -1] + corner).T,
            ".",
            ms=1.2,
            color=colour,
            rasterized=True,
        )
    if feature.found and scan.target.points:
        axes.plot(
            *((feature.points - middle) * [1, -1] + corner).T,
            "o",
            ms=5,
            mfc="none",
            mec=RED,
            mew=1.3,
        )


def save_plan(plan: Plan, path) -> None:
    """Write the picture as a PNG file."""
    use_style()
    figure, axes = plt.subplots(figsize=(7, 5.5), subplot_kw={"projection": "3d"})
    draw_way(axes, plan)
    found, kind = plan.predicted, plan.model.target.kind
    axes.set_title(
        f"{len(plan.T)} poses over the {kind} (black): {found.mm:.2g} mm and {found.deg:.2g}° predicted"
    )
    figure.savefig(path, dpi=150)
    plt.close(figure)


def draw_way(axes, plan: Plan) -> None:
    """Draw the flange's way and some fields of view in 3D; eye-to-hand, in the frame of
    the flange and target.
    """
    fans = field_of_view(plan.model) @ plan.R.mT + plan.T[:, None]
    origins = fans[:, 0]
    axes.plot(*origins.T, color=BLUE, lw=0.8, alpha=0.6)
    axes.scatter(
        *origins.T, color=BLUE, s=8, depthshade=False, label="sensor, on its way"
    )
    few = np.unique(np.linspace(0, len(fans) - 1, 5).round().astype(int))
    for k in few:
        draw_patch(axes, fans[k, 1:], SKY, 0.12, "field of view" if k == few[0] else "")
        draw_frame(
            axes,
            plan.R[k] @ plan.model.R_sensor,
            origins[k],
            0.06 * np.ptp(fans, axis=(0, 1)).max(),
        )
    R_view, T_view = plan.model.planes(plan.R, plan.T)
    seen = plan.model.seen(R_view, T_view, 5) @ R_view[..., ::2].mT + T_view[:, None]
    target = draw_lines(axes, plan.model.target.lines(seen.reshape(-1, 3)), "black", "")
    equal_axes(axes, np.vstack([origins, fans[few].reshape(-1, 3), target]))
    frame = "flange" if plan.model.to_hand else "base"
    axes.set(
        xlabel=f"{frame} x [mm]", ylabel=f"{frame} y [mm]", zlabel=f"{frame} z [mm]"
    )
    axes.locator_params(nbins=4)
    axes.computed_zorder = False
    axes.legend(loc="upper left", fontsize=8)


def field_of_view(model) -> np.ndarray:
    """The sensor's origin and the corners of its field of view, (5, 3), mm, in the
    frame that it is fixed to.
    """
    near, far = model.scanner.near, model.scanner.far
    z = np.array([0, near, far, far, near])
    x = model.scanner.half_width(z) * [0, -1, -1, 1, 1]
    return np.stack([x, z], axis=1) @ model.R_sensor[:, ::2].T + model.T_sensor
