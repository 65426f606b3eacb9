"""Figures and what notebooks hand out."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import LogLocator
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from numpy import ndarray
from numpy.typing import ArrayLike

from profilecal_pages.notebooks import at_defaults

# Okabe and Ito's colours, told apart by colour-blind readers and in grey print
BLUE = "#0072B2"
ORANGE = "#E69F00"
GREEN = "#009E73"
RED = "#D55E00"
SKY = "#56B4E9"
PURPLE = "#CC79A7"


def use_style() -> None:
    """Matplotlib settings of every notebook."""
    colours = [BLUE, ORANGE, GREEN, RED, SKY, PURPLE]
    plt.rcParams.update(
        {
            "figure.constrained_layout.use": True,
            "axes.prop_cycle": plt.cycler(color=colours),
            "axes.spines.top": False,
            "axes.spines.right": False,
            "legend.frameon": False,
            "savefig.bbox": "tight",  # as notebooks show them: nothing is cut off
            "svg.hashsalt": "profilecal",
        }
    )


@dataclass(frozen=True)
class Results:
    """What one notebook hands out: figures as PNG and SVG, in one style, and tables as
    CSV.
    """

    notebook: str
    folder: str  # the notebook's parameter `results_dir`; "" to write nothing

    def __post_init__(self) -> None:
        use_style()

    def _place(self, kind: str, name: str) -> Path:
        place = Path(self.folder) / kind / f"{self.notebook}_{name}"
        place.parent.mkdir(parents=True, exist_ok=True)
        return place

    def figure(self, figure: plt.Figure, name: str) -> None:
        """Show a figure and write it."""
        if self.folder:
            save(figure, self._place("figures", name).with_suffix(".png"))
        plt.show()

    def table(self, frame: pd.DataFrame, name: str, digits: int = 4) -> pd.DataFrame:
        """Write a table in full precision and return it rounded to `digits` significant
        digits for the reader.
        """
        if self.folder:
            place = self._place("tables", name).with_suffix(".csv")
            frame.to_csv(place, index=frame.index.name is not None)
        return frame.map(lambda v: f"{v:.{digits}g}" if isinstance(v, float) else v)


def save(figure: plt.Figure, place: Path) -> None:
    """Write a figure as PNG and, beside it, as SVG."""
    figure.savefig(place, dpi=200)
    figure.set_layout_engine("none")  # it is laid out
    figure.savefig(place.with_suffix(".svg"))


def draw_frame(
    axes: Axes3D, rotation: ArrayLike, origin: ndarray, length: float
) -> None:
    """Draw a coordinate frame in a 3D plot: x red, y green, z blue."""
    for axis, colour in zip(np.transpose(rotation), (RED, GREEN, BLUE), strict=True):
        ends = np.column_stack([origin, origin + length * axis])
        axes.plot(*ends, color=colour, lw=2)


def draw_patch(
    axes: Axes3D, corners: ArrayLike, colour: str, alpha: float = 0.25, label: str = ""
) -> None:
    """Draw a filled polygon with corners (n, 3) in a 3D plot."""
    patch = Poly3DCollection(
        [corners], facecolor=colour, edgecolor=colour, alpha=alpha, label=label
    )
    axes.add_collection3d(patch)


def equal_axes(axes: Axes3D, points: ArrayLike) -> None:
    """Give a 3D plot the same scale on its three axes, around points (n, 3)."""
    axes.set_box_aspect((1, 1, 1))
    axes.auto_scale_xyz(*np.transpose(points))
    axes.set_aspect("equal", adjustable="datalim")


def draw_scan(
    axes: Axes3D, rotation: ArrayLike, origin: ndarray, depth: float, colour: str
) -> ndarray:
    """Draw a scanner's fan of light in a 3D plot, as wide as it is deep; return its
    corners (3, 3).
    """
    x, _, z = np.transpose(rotation)
    left = origin + depth * (z - x / 2)
    right = origin + depth * (z + x / 2)
    corners = np.array([origin, left, right])
    draw_patch(axes, corners, colour, alpha=0.15)
    return corners


def beside(
    points: ndarray, point: ArrayLike, direction: ndarray
) -> tuple[ndarray, ndarray]:
    """Points (..., 3) seen from beside a line: how far along it, and across, in the
    view that spreads them most.
    """
    offset = points - point
    along = offset @ direction
    off_line = (offset - along[..., None] * direction).reshape(-1, 3)
    across = np.linalg.svd(off_line - off_line.mean(axis=0), full_matrices=False)[2][0]
    across -= (across @ direction) * direction
    return along, np.sign(across[0]) * offset @ across


def noise_curves(axes: Axes, m: Sequence, sigma_mm: Sequence, e: Sequence) -> None:
    """Draw e (k, l) over m (l,), one curve for each sigma_mm (k,), named at its right
    end.
    """
    shades = plt.get_cmap("viridis")(np.linspace(0, 0.85, len(sigma_mm)))
    for sigma, curve, shade in zip(sigma_mm, e, shades, strict=True):
        axes.plot(m, curve, color=shade, lw=1.5)
        beside = {"x": m[-1], "y": curve[-1], "va": "center", "fontsize": 8}
        axes.text(s=f"  {sigma:.3g}", color=shade, **beside)
    axes.text(s="  σ [mm]\n\n", **beside)


def plot_columns(frame: pd.DataFrame, x: str, y: str, hue: str, folder: Path) -> Path:
    """Draw column y over column x, a line for each value of `hue`: the median, and the
    range from least to most. Returns where the picture is. Raises ValueError for a
    column that is not there or holds no numbers.
    """
    if missing := {x, y, hue or x} - {*frame}:
        names = ", ".join(frame)
        raise ValueError(f"no column named {missing.pop()!r}; there are {names}")
    numbers = pd.to_numeric(frame[y], "coerce").astype(float)
    parts = ["min", "median", "max"]
    shown = frame.assign(**{y: numbers}).pivot_table(y, x, hue or None, parts)
    if shown.empty:
        raise ValueError(f"column {y} holds no numbers, so it cannot be drawn")
    use_style()
    label = f"{y} (median, range)"
    axes = shown["median"].plot(
        style="o-", ylabel=label, figsize=(6, 4), legend=bool(hue)
    )
    for name in shown["median"]:
        low, high = shown["min", name], shown["max", name]
        axes.fill_between(shown.index, low, high, alpha=0.15, lw=0)
    place = folder / f"{y}_over_{x}.png".replace("/", "-")
    save(axes.figure, place)
    plt.close(axes.figure)
    return place


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Show rows of texts under a header, as a notebook's text would have them: formulas
    in them are typeset.
    """
    rule = ["---"] * len(header)
    text("\n".join(f"| {' | '.join(line)} |" for line in (header, rule, *rows)))


def text(*sentences: str) -> None:
    """Show sentences as a notebook's text would have them: formulas in them are
    typeset.
    """
    from IPython.display import Markdown, display

    display(Markdown(" ".join(sentences)))


def checked(*sentences: str) -> None:
    """Show what a notebook checked, as a quotation."""
    text("> **Checked.**", *sentences)


def share(hits: ArrayLike) -> str:
    """How large a share of trials hit, with its 95 % interval, exact for any number of
    them, such as "0.83 [0.74, 0.90]".
    """
    from scipy.stats import binomtest

    hits = np.ravel(hits)
    low, high = binomtest(int(hits.sum()), len(hits)).proportion_ci()
    return f"{hits.mean():.2f} [{low:.2f}, {high:.2f}]"


def below(values: ArrayLike, limit: float) -> str:
    """The limit in words, or by how much a value misses it, which under a page's own
    parameters is an error. Raises ValueError.
    """
    largest = np.max(np.abs(values))
    if largest < limit:
        return f"below {limit:g}".replace("e-0", "e-")
    if at_defaults():
        raise ValueError(f"a value is {largest:.2g}; expected less than {limit:g}")
    return f"{largest:.1g}, not below {limit:g}".replace("e-0", "e-")


def plain_log(*scales: Axis) -> None:
    """Label logarithmic x or y axes of plots with plain numbers, at 1, 2, 5, 10, …"""
    for axis in scales:
        axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_locator(plt.NullLocator())
