"""Figures and what notebooks hand out. Nothing else in the library imports matplotlib."""

from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.ticker import LogLocator

# Okabe and Ito's colours, told apart by colour-blind readers and in grey print
BLUE = "#0072B2"
ORANGE = "#E69F00"
GREEN = "#009E73"
RED = "#D55E00"
SKY = "#56B4E9"
PURPLE = "#CC79A7"


def use_style() -> None:
    """Matplotlib settings of every notebook."""
    plt.rcParams.update(
        {
            "figure.constrained_layout.use": True,
            "axes.prop_cycle": plt.cycler(
                color=[BLUE, ORANGE, GREEN, RED, SKY, PURPLE]
            ),
            "axes.spines.top": False,
            "axes.spines.right": False,
            "legend.frameon": False,
            "savefig.bbox": "tight",  # as notebooks show them: nothing is cut off
            "svg.hashsalt": "profilecal",
        }
    )


@dataclass(frozen=True)
class Results:
    """What one notebook hands out: figures as PNG and SVG, tables as CSV."""

    notebook: str
    folder: str  # the notebook's parameter `results_dir`; "" to write nothing

    def _place(self, kind: str, name: str) -> Path:
        place = Path(self.folder) / kind / f"{self.notebook}_{name}"
        place.parent.mkdir(parents=True, exist_ok=True)
        return place

    def figure(self, figure: plt.Figure, name: str) -> None:
        """Show a figure and write it."""
        if self.folder:
            for suffix in (".png", ".svg"):
                figure.savefig(
                    self._place("figures", name).with_suffix(suffix), dpi=200
                )
                figure.set_layout_engine("none")  # it is laid out
        plt.show()

    def table(self, frame: pd.DataFrame, name: str, digits: int = 4) -> pd.DataFrame:
        """Write a table in full precision and return it rounded to `digits` significant
        digits for the reader.
        """
        if self.folder:
            frame.to_csv(
                self._place("tables", name).with_suffix(".csv"),
                index=frame.index.name is not None,
            )
        return frame.map(
            lambda v: f"{v:.{digits}g}" if isinstance(v, float | np.floating) else v
        )


def plot_changes(parts: dict, size: float, of: str, met: str) -> plt.Figure:
    """The changes of a table's numbers, in half units of the last digit, by part;
    within the grey band a number prints alike. `size`: the largest; `of`, `met`: what
    they are and what they achieve, for the axis and the title.
    """
    figure, axes = plt.subplots(figsize=(8, 2.8))
    start = 0
    for (name, changes), colour in zip(
        parts.items(), (BLUE, ORANGE, GREEN, PURPLE, SKY), strict=False
    ):
        axes.vlines(start + np.arange(len(changes)), 0, changes, color=colour, lw=3)
        axes.annotate(
            name, (start + len(changes) / 2 - 0.5, 1.12), ha="center", color=colour
        )
        start += len(changes)
    axes.axhspan(-1, 1, color="0.92", zorder=0)
    axes.axhline(0, color="0.6", lw=0.8)
    axes.set(xlabel=of, ylabel="change [half units]", ylim=(-1.4, 1.4), xticks=[])
    axes.set_title(f"The largest change is {size:.1f} half units; {met}", pad=12)
    return figure


def draw_frame(axes, rotation, origin, length: float) -> None:
    """Draw a coordinate frame in a 3D plot: x red, y green, z blue."""
    for axis, colour in zip(np.asarray(rotation).T, (RED, GREEN, BLUE), strict=True):
        axes.plot(
            *np.column_stack([origin, origin + length * axis]), color=colour, lw=2
        )


def draw_patch(
    axes, corners, colour: str, alpha: float = 0.25, label: str = ""
) -> None:
    """Draw a filled polygon with corners (n, 3) in a 3D plot."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    axes.add_collection3d(
        Poly3DCollection(
            [corners], facecolor=colour, edgecolor=colour, alpha=alpha, label=label
        )
    )


def equal_axes(axes, points) -> None:
    """Give a 3D plot the same scale on its three axes, around points (n, 3)."""
    low, high = np.min(points, axis=0), np.max(points, axis=0)
    half = np.array([-1, 1]) * (high - low).max() / 2
    x, y, z = ((low + high) / 2)[:, None] + half
    axes.set(xlim=x, ylim=y, zlim=z, box_aspect=(1, 1, 1))


def draw_scan(axes, rotation, origin, depth: float, colour: str) -> np.ndarray:
    """Draw a scanner's fan of light in a 3D plot, as wide as it is deep; return its
    corners (3, 3).
    """
    x, _, z = np.transpose(rotation)
    corners = np.array(
        [origin, origin + depth * (z - x / 2), origin + depth * (z + x / 2)]
    )
    draw_patch(axes, corners, colour, alpha=0.15)
    return corners


def noise_curves(axes, m, sigma_mm, e) -> None:
    """Draw e (k, l) over m (l,), one curve for each sigma_mm (k,), named at its right
    end.
    """
    shades = plt.get_cmap("viridis")(np.linspace(0, 0.85, len(sigma_mm)))
    for sigma, curve, shade in zip(sigma_mm, e, shades, strict=True):
        axes.plot(m, curve, color=shade, lw=1.5)
        place = m[-1], curve[-1]
        axes.annotate(
            f"{sigma:.3g}",
            place,
            (5, 0),
            textcoords="offset points",
            va="center",
            color=shade,
            fontsize=8,
        )
    axes.annotate("σ [mm]", place, (5, 10), textcoords="offset points", fontsize=9)


def plot_columns(frame: pd.DataFrame, x: str, y: str, hue: str, folder: Path) -> Path:
    """Draw column y over column x, a line for each value of `hue`: the median, and the
    range from least to most. Raises ValueError for a column that is not there or holds
    no numbers.
    """
    if missing := {x, y, hue or x} - {*frame}:
        raise ValueError(
            f"no column named {missing.pop()!r}; there are {', '.join(frame)}"
        )
    numbers = frame.assign(**{y: pd.to_numeric(frame[y], "coerce").astype(float)})
    shown = numbers.pivot_table(y, x, hue or None, ["min", "median", "max"])
    if shown.empty:
        raise ValueError(f"column {y} holds no numbers, so it cannot be drawn")
    use_style()
    axes = shown["median"].plot(
        style="o-", ylabel=f"{y} (median, range)", figsize=(6, 4), legend=bool(hue)
    )
    for name in shown["median"]:
        axes.fill_between(
            shown.index, shown["min", name], shown["max", name], alpha=0.15, lw=0
        )
    place = folder / f"{y}_over_{x}.png".replace("/", "-")
    axes.figure.savefig(place, dpi=200)
    axes.figure.savefig(place.with_suffix(".svg"))
    plt.close(axes.figure)
    return place


def table(header, rows) -> None:
    """Show rows of texts under a header, as a notebook's text would have them: formulas
    in them are typeset.
    """
    text(
        "\n".join(
            f"| {' | '.join(line)} |" for line in (header, ["---"] * len(header), *rows)
        )
    )


def text(*sentences: str) -> None:
    """Show sentences as a notebook's text would have them: formulas in them are
    typeset.
    """
    from IPython.display import Markdown, display

    display(Markdown(" ".join(sentences)))


def checked(*sentences: str) -> None:
    """Show what a notebook checked, as a quotation."""
    text("> **Checked.**", *sentences)


def below(values, limit: float) -> str:
    """The limit in words. Raises ValueError if a value is not nearer to zero."""
    largest = np.max(np.abs(values))
    if not largest < limit:
        raise ValueError(f"a value is {largest:.2g}; expected less than {limit:g}")
    return f"below {limit:g}".replace("e-0", "e-")


def plain_log(*scales) -> None:
    """Label logarithmic x or y axes of plots with plain numbers, at 1, 2, 5, 10, …"""
    for axis in scales:
        axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_locator(plt.NullLocator())
