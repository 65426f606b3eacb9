"""Pictures of the edge notebooks: scans of an edge, its criteria, a ball that checks it."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from profilecal.geometry.poses import circle_around
from profilecal.report.figures import (
    BLUE,
    GREEN,
    OF_METHOD,
    ORANGE,
    PURPLE,
    draw_patch,
    equal_axes,
)


def plot_by_row(panels, runs: pd.DataFrame, by: str, labels: dict[str, str], published: dict) -> None:
    """Draw columns of `labels`, {column: axis label}, a panel each: the median and the middle half of the runs, a row
    for each value of the column `by`. `published` {column: (least, greatest)} is drawn as a band."""
    for axes, (column, label) in zip(panels, labels.items(), strict=True):
        parts = runs.groupby(by, sort=False)[column].quantile([0.25, 0.5, 0.75]).unstack()
        low, middle, high = parts.to_numpy().T
        if column in published:
            axes.axvspan(*published[column], color=OF_METHOD["published"], alpha=0.2, lw=0, label="published")
        style = {
            "fmt": "o",
            "ms": 5,
            "color": OF_METHOD["closed form"],
            "label": "median and middle half of the scenes",
        }
        axes.errorbar(middle, range(len(parts)), xerr=[middle - low, high - middle], **style)
        axes.set(xlabel=label, yticks=range(len(parts)), yticklabels=parts.index)
    panels[0].invert_yaxis()


def plot_medians(axes, runs: pd.DataFrame, x: str, y: str, hue: str, label: str) -> None:
    """Draw the median of column y over column x, a line for each value of column `hue`, which `label` formats."""
    medians = runs.groupby([hue, x])[y].median().unstack(0)
    shades = plt.get_cmap("viridis")(np.linspace(0, 0.85, len(medians.columns)))
    for value, shade in zip(medians, shades, strict=True):
        axes.plot(medians.index, medians[value], ".-", color=shade, label=label.format(value))
    axes.set(xlabel=x, xscale="log")


def plot_clouds(axes, clouds: dict, view) -> None:
    """Draw clouds {label: errors (n, 3)} around no error, as seen in the plane of the rows `view` (2, 3)."""
    shades = plt.get_cmap("viridis")(np.linspace(0.85, 0, len(clouds)))
    for (label, cloud), shade in zip(clouds.items(), shades, strict=True):
        axes.plot(*(cloud @ view.T).T, ".", ms=3, color=shade, label=label)
    axes.plot(0, 0, "k+", ms=14, mew=2)
    axes.text(0, 0.98, "no error", ha="center", va="top", transform=axes.get_xaxis_transform())
    axes.set(aspect="equal")


def beside_line(points, point, direction) -> tuple[np.ndarray, np.ndarray]:
    """Points (..., 3) seen from beside a line through `point` along `direction`: how far along it, how far above.

    The view is the one that spreads the points most.
    """
    offset = np.asarray(points) - point
    along = offset @ direction
    off_line = (offset - along[..., None] * direction).reshape(-1, 3)
    above = np.linalg.svd(off_line - off_line.mean(axis=0), full_matrices=False)[2][0]
    above = above - (above @ direction) * direction
    return along, offset @ (above / np.linalg.norm(above))


def draw_vectors(axes, points, direction, colour: str = BLUE) -> None:
    """Draw the vectors from the first of points (n, 3) to the others, on one scale, seen from beside a line along
    `direction` through the first; the view is `beside_line`'s."""
    along, above = beside_line(points, points[0], direction)
    start = np.zeros(len(points) - 1)
    axes.axhline(0, color="black", lw=1, zorder=0)
    axes.quiver(start, start, along[1:], above[1:], angles="xy", scale_units="xy", scale=1, color=colour, width=0.006)
    axes.plot(along, above, "o", ms=4, color=ORANGE)
    axes.plot(0, 0, "o", ms=10, mfc="none", mew=2, color="black")
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.08, 0.15)


def draw_edge_group(axes, edge, rotation, origins, points) -> None:
    """Draw in a 3D plot what a scanner of one orientation `rotation` (3, 3) sees of an edge from `origins` (n, 3): its
    first, middle and last scan, and the edge's points (n, 3). The edge runs from left to right, the scanner is above.
    """
    depth = 1.2 * np.linalg.norm(points - origins, axis=1).max()
    up = (rotation[:, 2] @ edge.direction) * edge.direction - rotation[:, 2]
    up /= np.linalg.norm(up)
    view = np.stack([edge.direction, np.cross(up, edge.direction), up], axis=-1)
    turned, seen, places = view.T @ rotation, (points - edge.point) @ view, (origins - edge.point) @ view
    corners = np.array([[0, 0, 0], [-0.3, 0, 1], [0.3, 0, 1]]) * depth @ turned.T
    for k, colour in zip((0, len(points) // 2, -1), (BLUE, GREEN, PURPLE), strict=True):
        draw_patch(axes, places[k] + corners, colour, alpha=0.15)
    axes.plot(*places.T, "o-", color="0.4", ms=3, lw=1)
    ends = np.outer(1.4 * np.abs(seen[:, 0]).max() * np.array([-1, 1]), [1, 0, 0])
    axes.plot(*ends.T, color="black", lw=2)
    axes.plot(*seen.T, "o", color=ORANGE, ms=4)
    axes.text(*ends[1], " edge", va="center")
    axes.text(*places[places[:, 0].argmax()], "  scanner's path", color="0.3", va="center")
    everything = np.vstack([ends, *(places + corner for corner in corners)])
    low, high = everything.min(axis=0), everything.max(axis=0)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(high - low, zoom=1.2)
    axes.set_axis_off()


def draw_ball_scan(axes, clouds, radius: float) -> None:
    """Draw in a 3D plot points (G, n, 3) of a ball around the origin, a colour for each G, and circles of latitude."""
    for cloud, colour in zip(clouds, plt.get_cmap("viridis")(np.linspace(0, 0.95, len(clouds))), strict=True):
        axes.plot(*cloud.T, ".", ms=1.5, color=colour)
    for latitude in np.radians([-60, -30, 0, 30, 60]):
        height = np.array([0, 0, radius * np.sin(latitude)])
        axes.plot(*circle_around(height, [0, 0, 1], radius * np.cos(latitude)).T, color="0.7", lw=0.7)
    equal_axes(axes, radius * np.array([[-1, -1, -1], [1, 1, 1]]))
    axes.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")
    ticks = radius * np.array([-0.5, 0, 0.5])
    axes.set(xticks=ticks, yticks=ticks, zticks=ticks)


def error_bars(axes, columns: dict, colours) -> None:
    """Draw medians and 95 % ranges side by side; `columns` maps each name to pandas groups with the same keys."""
    for k, ((name, groups), colour) in enumerate(zip(columns.items(), colours, strict=True)):
        low, middle, high = (groups.quantile(q) for q in (0.025, 0.5, 0.975))
        x = np.arange(len(middle)) + 0.2 * (k - (len(columns) - 1) / 2)
        axes.errorbar(x, middle, [middle - low, high - middle], fmt="o", ms=4, lw=2, color=colour, label=name)
    axes.set(xticks=range(len(middle)), xticklabels=middle.index)
