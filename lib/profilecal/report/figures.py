"""Figures and what notebooks hand out. Nothing else in the library imports matplotlib."""

from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from profilecal.geometry.poses import circle_around
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


def plain_ticks(*scales) -> None:
    """Number logarithmic axes, such as `axes.xaxis`, at 1, 2 and 5, without powers of ten."""
    for scale in scales:
        for set_formatter in (scale.set_major_formatter, scale.set_minor_formatter):
            set_formatter(lambda value, _: f"{value:g}" if f"{value:.0e}"[0] in "125" else "")


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


def draw_scan(axes, rotation, origin, depth: float, colour: str, label: str = "") -> None:
    """Draw a scanner's fan of light in a 3D plot: from its origin to `depth`, as wide as it is deep."""
    rotation = np.asarray(rotation)
    ends = [origin + depth * (rotation[:, 2] + side * rotation[:, 0] / 2) for side in (-1, 1)]
    draw_patch(axes, np.array([origin, *ends]), colour, alpha=0.15, label=label)


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


def noise_curves(axes, m, sigma_mm, e) -> None:
    """Draw e (k, l) over m (l,), one curve for each sigma_mm (k,), named at its right end."""
    shades = plt.get_cmap("viridis")(np.linspace(0, 0.85, len(sigma_mm)))
    for sigma, curve, shade in zip(sigma_mm, e, shades, strict=True):
        axes.plot(m, curve, color=shade, lw=1.5)
        axes.annotate(f"{sigma:g}", (m[-1], curve[-1]), (4, 0), textcoords="offset points", va="center", color=shade)
    axes.annotate("σ [mm]", (m[-1], e[-1, -1]), (4, 12), textcoords="offset points", fontsize=9)


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
    axes.plot(*expected.T, "-" if on_curve else "x" + line, ms=8, mew=2, color=RED, label="expected")
    if not on_curve:
        axes.plot(*np.stack([seen.points[0, k], expected]).transpose(2, 0, 1), "k:", lw=1)
    axes.set(title=seen.kind, xlabel="x in the scan [mm]", ylabel="z in the scan [mm]")
    axes.margins(0.3)
    axes.invert_yaxis()


def draw_motion(axes, scene, worst) -> None:
    """Draw the first problem of a `scenes.Scene` in 3D: target, sensor positions, and at the first of them the worst
    known direction `worst` (6,) of the sensor pose, in the units of `observability`: an arrow for a translation, an arc
    with an axis for a rotation."""
    seen, truth = scene.observations, scene.truth
    rotation = seen.R_flange[0] @ truth.rotation[0]
    origin = seen.T_flange[0] + seen.R_flange[0] @ truth.translation[0]
    middle = truth.placements[0][0][0]
    axes.scatter(*origin.T, s=6, color=BLUE, depthshade=False)
    for g in np.unique(seen.group):
        first = np.flatnonzero(seen.group == g)[0]
        draw_frame(axes, rotation[first], origin[first], 14)
        axes.plot(*np.stack([origin[first], middle]).T, color="0.7", lw=0.7)
    lines = scene.target.lines(middle + np.outer([-60, 60], scene.target.frame[1][:, 2]))
    for line in lines:
        axes.plot(*line.T, color="black", lw=2.5)
    shift, turn = rotation[0] @ worst[:3], rotation[0] @ worst[3:]
    name = "arrow" if shift @ shift > turn @ turn else "turn"
    along = shift if name == "arrow" else turn
    along = 60 * along / np.linalg.norm(along)
    axes.quiver(*origin[0], *along, color=PURPLE, lw=3, arrow_length_ratio=0.25)
    if name == "turn":
        axes.plot(*circle_around(origin[0] + 0.6 * along, along, 15)[:70].T, color=PURPLE, lw=3)
    equal_axes(axes, np.vstack([origin, origin[:1] + along, *lines]))
    axes.set(xticklabels=[], yticklabels=[], zticklabels=[])


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
