"""Figures and what notebooks hand out. The only module that imports matplotlib."""

from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from profilecal.scorecard import Scorecard

# Okabe and Ito's colours, told apart by colour-blind readers and in grey print
BLUE, ORANGE, GREEN, RED, SKY, PURPLE, YELLOW = (
    "#0072B2",
    "#E69F00",
    "#009E73",
    "#D55E00",
    "#56B4E9",
    "#CC79A7",
    "#F0E442",
)


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


def plot_rounding(axes, draws, published: float, ours: float, name: str) -> None:
    """One quantity under the rounding of a printed table: all results that the table allows, and the published one."""
    low, high = np.percentile(draws, [2.5, 97.5])
    axes.hist(draws, bins=60, density=True, color=SKY, alpha=0.6)
    axes.axvspan(low, high, color=SKY, alpha=0.25, lw=0)
    axes.axvline(ours, color=BLUE, lw=1.5)
    axes.axvline(published, color=RED, lw=2, ls="--")
    axes.set(xlabel=name, yticks=[])
    axes.spines["left"].set_visible(False)
    axes.locator_params(axis="x", nbins=3)
    axes.ticklabel_format(axis="x", useOffset=False)


def rounding_legend(figure: plt.Figure) -> None:
    """The key to `plot_rounding`, once for a figure."""
    handles = [
        Line2D([], [], color=RED, lw=2, ls="--", label="published"),
        Line2D([], [], color=BLUE, lw=1.5, label="ours, from the table as printed"),
        Patch(color=SKY, alpha=0.6, label="ours, from tables that round to it (band: 95 % of them)"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3)


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


def circle_points(centre, normal, radius: float, count: int = 90) -> np.ndarray:
    """Points (count, 3) on a circle in space."""
    normal = np.asarray(normal, dtype=float) / np.linalg.norm(normal)
    u = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    u /= np.linalg.norm(u)
    angle = np.linspace(0, 2 * np.pi, count)[:, None]
    return centre + radius * (np.cos(angle) * u + np.sin(angle) * np.cross(normal, u))


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

    The view is the one that shows most of the distances from the line.
    """
    offset = np.asarray(points) - point
    along = offset @ direction
    off_line = offset - along[..., None] * direction
    above = np.linalg.svd(off_line.reshape(-1, 3), full_matrices=False)[2][0]
    return along, offset @ above
