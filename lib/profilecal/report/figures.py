"""Figures and what notebooks hand out. Nothing else in the library imports matplotlib."""

from dataclasses import dataclass
from itertools import combinations, product
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.ticker import LogLocator

from profilecal.papers.scorecard import Scorecard

# Okabe and Ito's colours, told apart by colour-blind readers and in grey print
BLUE = "#0072B2"
ORANGE = "#E69F00"
GREEN = "#009E73"
RED = "#D55E00"
SKY = "#56B4E9"
PURPLE = "#CC79A7"
YELLOW = "#F0E442"
OF_METHOD = {  # the same in every notebook
    "closed form": ORANGE,
    "joint": BLUE,
    "robust joint": GREEN,
    "published": RED,
    "bound": "black",
}


def use_style() -> None:
    """Matplotlib settings of every notebook."""
    plt.rcParams.update(
        {
            "figure.dpi": 100,
            "figure.constrained_layout.use": True,
            "axes.prop_cycle": plt.cycler(color=[BLUE, ORANGE, GREEN, RED, SKY, PURPLE]),
            "axes.spines.top": False,
            "axes.spines.right": False,
            "font.size": 10,
            "legend.frameon": False,
            "svg.hashsalt": "profilecal",
        }
    )


@dataclass(frozen=True)
class Results:
    """What one notebook hands out: figures as PNG and SVG, tables as CSV, its rows of the scorecard.

    `folder` is the notebook's parameter `results_dir`; empty, nothing is written.
    """

    notebook: str
    folder: str

    def _place(self, kind: str, name: str) -> Path:
        place = Path(self.folder) / kind / f"{self.notebook}_{name}"
        place.parent.mkdir(parents=True, exist_ok=True)
        return place

    def figure(self, figure: plt.Figure, name: str) -> None:
        """Show a figure and write it."""
        if self.folder:
            for suffix in (".png", ".svg"):
                figure.savefig(self._place("figures", name).with_suffix(suffix), dpi=200)
        plt.show()

    def table(self, frame: pd.DataFrame, name: str, digits: int = 4) -> pd.DataFrame:
        """Write a table in full precision and return it rounded to `digits` significant digits for the reader."""
        if self.folder:
            frame.to_csv(self._place("tables", name).with_suffix(".csv"), index=frame.index.name is not None)
        return frame.map(lambda v: f"{v:.{digits}g}" if isinstance(v, float | np.floating) else v)

    def scorecard(self, rows: list[dict]) -> Scorecard:
        """Show the notebook's rows of the scorecard; they are stored in the executed notebook."""
        return Scorecard(rows)


def plot_rounding(axes, draws, published: float, ours: float, name: str) -> None:
    """One quantity under the rounding of a printed table: all results that the table allows, and the published one."""
    low, high = np.percentile(draws, [2.5, 97.5])
    band = "ours, from tables that round to it (band: 95 % of them)"
    axes.hist(draws, bins=60, density=True, color=SKY, alpha=0.6, label=band)
    axes.axvspan(low, high, color=SKY, alpha=0.25, lw=0)
    axes.axvline(ours, color=BLUE, lw=1.5, label="ours, from the table as printed")
    axes.axvline(published, color=RED, lw=2, ls="--", label="published")
    axes.set(xlabel=name, yticks=[])
    axes.spines["left"].set_visible(False)
    axes.locator_params(axis="x", nbins=3)
    axes.ticklabel_format(axis="x", useOffset=False)


def rounding_legend(figure: plt.Figure) -> None:
    """The key to `plot_rounding`, once for a figure."""
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, reverse=True)


def draw_frame(axes, rotation, origin, length: float, name: str = "") -> None:
    """Draw a coordinate frame in a 3D plot: x red, y green, z blue."""
    for axis, colour in zip(np.asarray(rotation).T, (RED, GREEN, BLUE), strict=True):
        tip = origin + length * axis
        axes.plot(*np.column_stack([origin, tip]), color=colour, lw=2)
    if name:
        axes.text(*(origin - 0.25 * length * np.asarray(rotation)[:, 2]), name, ha="center", va="center")


def draw_arrow(axes, start, end, colour: str, text: str, aside, lw: float = 2, ls: str = "-") -> None:
    """Draw an arrow in a 3D plot, with a text beside its middle."""
    start, way = np.asarray(start, dtype=float), np.subtract(end, start)
    tip = 18 / np.linalg.norm(way)
    axes.quiver(*start, *way, color=colour, lw=lw, ls=ls, arrow_length_ratio=tip)
    box = {"facecolor": "white", "alpha": 0.8, "lw": 0, "pad": 1}
    axes.text(*(start + 0.5 * way + aside), text, color=colour, ha="center", va="center", bbox=box)


def draw_patch(axes, corners, colour: str, alpha: float = 0.25, label: str = "") -> None:
    """Draw a filled polygon with corners (n, 3) in a 3D plot."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    axes.add_collection3d(Poly3DCollection([corners], facecolor=colour, edgecolor=colour, alpha=alpha, label=label))


def equal_axes(axes, points) -> None:
    """Give a 3D plot the same scale on its three axes, around points (n, 3)."""
    points = np.asarray(points).reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    middle, half = (low + high) / 2, (high - low).max() / 2
    axes.set(xlim=(middle[0] - half, middle[0] + half), ylim=(middle[1] - half, middle[1] + half))
    axes.set(zlim=(middle[2] - half, middle[2] + half), box_aspect=(1, 1, 1))


def draw_scan(axes, rotation, origin, depth: float, colour: str, label: str = "") -> np.ndarray:
    """Draw a scanner's fan of light in a 3D plot, from its origin to `depth`, as wide as it is deep.

    Returns its corners (3, 3).
    """
    rotation = np.asarray(rotation)
    ends = [origin + depth * (rotation[:, 2] + side * rotation[:, 0] / 2) for side in (-1, 1)]
    corners = np.array([origin, *ends])
    draw_patch(axes, corners, colour, alpha=0.15, label=label)
    return corners


def noise_curves(axes, m, sigma_mm, e) -> None:
    """Draw e (k, l) over m (l,), one curve for each sigma_mm (k,), named at its right end."""
    sigma_mm, e = np.asarray(sigma_mm), np.asarray(e)
    shades = plt.get_cmap("viridis")(np.linspace(0, 0.85, len(sigma_mm)))
    level = np.average(e[:, -3:].mean(axis=1) / sigma_mm, weights=sigma_mm)  # evenly spaced names do not collide
    for sigma, curve, shade in zip(sigma_mm, e, shades, strict=True):
        axes.plot(m, curve, color=shade, lw=1.5)
        place = m[-1], level * sigma
        axes.annotate(f"{sigma:.3g}", place, (5, 0), textcoords="offset points", va="center", color=shade, fontsize=9)
    axes.annotate("σ [mm]", place, (5, 10), textcoords="offset points", fontsize=9)


def draw_seen_and_expected(axes, scene, turn_deg: float, shift_mm: float) -> None:
    """Draw one scan of a `scenes.Scene` (dots), and what a sensor pose that wrong expects in its place (crosses)."""
    from scipy.spatial.transform import Rotation

    seen, truth = scene.observations, scene.truth
    k = seen.points.shape[1] // 2
    R = truth.rotation[0] @ Rotation.from_rotvec(turn_deg * np.ones(3) / np.sqrt(3), degrees=True).as_matrix()
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
    """Draw the first problem of a `scenes.Scene` in 3D, as it is and with the sensor pose and the target of `other`, a
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
    """Draw the points that a perfect scanner sees in the first problem of a `scenes.Scene` (dots), and with the sensor
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
    for (name, values), shade, line in zip(inside.items(), shades, lines, strict=True):
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


def plot_columns(frame: pd.DataFrame, x: str, y: str, hue: str, folder: Path) -> Path:
    """Draw column y over column x, a line for each value of `hue`: the median, and the range from least to most.

    Raises ValueError for a column that is not there or holds no numbers.
    """
    for name in filter(None, (x, y, hue)):
        if name not in frame:
            raise ValueError(f"no column named {name!r}; there are {', '.join(frame)}")
    if not pd.api.types.is_numeric_dtype(frame[y]):
        raise ValueError(f"column {y} holds no numbers, so it cannot be drawn")
    use_style()
    figure, axes = plt.subplots(figsize=(6, 4))
    for value, part in frame.groupby(hue) if hue else [("", frame)]:
        spread = part.groupby(x)[y].agg(["min", "median", "max"]).dropna()
        (line,) = axes.plot(spread.index, spread["median"], "o-", label=f"{hue} = {value}")
        axes.fill_between(spread.index, spread["min"], spread["max"], color=line.get_color(), alpha=0.15, lw=0)
    axes.set(xlabel=x, ylabel=f"{y} (median, range)")
    if hue:
        axes.legend()
    place = folder / f"{y}_over_{x}.png".replace("/", "-")
    figure.savefig(place, dpi=200)
    figure.savefig(place.with_suffix(".svg"))
    plt.close(figure)
    return place


def draw_matrix(axes, table: pd.DataFrame) -> None:
    """Draw a table of positive numbers as shades, on a logarithmic scale, with the numbers; dark is large."""
    values = np.log10(table.to_numpy(dtype=float))
    low, high = np.nanmin(values), np.nanmax(values)
    axes.imshow(values, cmap="Blues", vmin=low, vmax=high + 0.2 * (high - low), aspect="auto")
    for (i, j), value in np.ndenumerate(values):
        colour = "white" if value > 0.3 * low + 0.7 * high else "black"
        text = f"{10**value:.2g}" if np.isfinite(value) else ""
        axes.text(j, i, text, ha="center", va="center", color=colour)
    axes.set(xticks=range(table.shape[1]), yticks=range(table.shape[0]), yticklabels=table.index)
    axes.set_xticklabels(table.columns, rotation=30, ha="right", rotation_mode="anchor")
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0)


def plot_with_interval(axes, frame: pd.DataFrame, x: str, y: str, **style) -> None:
    """Draw column y of a table over column x, with bars from column y_low to column y_high."""
    bars = [frame[y] - frame[f"{y}_low"], frame[f"{y}_high"] - frame[y]]
    axes.errorbar(frame[x], frame[y], bars, **{"marker": "o", "ms": 4, "capsize": 2} | style)


def plot_rows(axes, frame: pd.DataFrame, x: str, shift: float, **style) -> None:
    """Draw column x of a table, a row of the figure for each of its rows, `shift` below it, with bars as above."""
    bars = [frame[x] - frame[f"{x}_low"], frame[f"{x}_high"] - frame[x]]
    axes.errorbar(frame[x], np.arange(len(frame)) + shift, xerr=bars, **{"fmt": "o", "ms": 5, "capsize": 2} | style)


def plain_log(*scales) -> None:
    """Label logarithmic x or y axes of plots with plain numbers, at 1, 2, 5, 10, …"""
    for axis in scales:
        axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_locator(plt.NullLocator())


def draw_box(axes, points) -> None:
    """Draw points (n, 3), mm, in a 3D plot, with their mean and the box of the base's directions around them."""
    axes.scatter(*points.T, color=BLUE, s=14, depthshade=False)
    axes.scatter(*points.mean(axis=0), color="black", s=40, depthshade=False, label="mean")
    corners = np.array(list(product(*np.stack([points.min(axis=0), points.max(axis=0)], axis=1))))
    for first, second in combinations(corners, 2):
        if np.sum(first != second) == 1:
            axes.plot(*np.stack([first, second]).T, color="0.6", lw=0.8)
    equal_axes(axes, points)
    axes.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")
    axes.locator_params(nbins=4)
    axes.legend(loc="upper left")
