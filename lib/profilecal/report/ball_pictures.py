"""A ball cut by the scan plane, as notebook 29 draws it."""

import matplotlib.pyplot as plt
import numpy as np

from profilecal.geometry.poses import circle_around
from profilecal.report.figures import ORANGE, SKY, draw_patch, equal_axes


def draw_cut_ball(axes, centre, radius: float, steepest_deg: float) -> None:
    """Draw a ball in the sensor frame (3D), the circle that the scan plane y = 0 cuts from it, and the arc seen."""
    for normal in np.eye(3):
        axes.plot(*circle_around(centre, normal, radius).T, color="0.6", lw=0.8)
    foot, beside = centre * [1, 0, 1], centre[1]
    circle = np.sqrt(radius**2 - beside**2)
    axes.plot(*circle_around(foot, np.array([0.0, 1, 0]), circle).T, color=ORANGE, lw=1)
    angle = np.radians(np.linspace(-1, 1, 50) * min(steepest_deg, 90))
    arc = foot + circle * np.column_stack([np.sin(angle), 0 * angle, np.cos(angle)])
    axes.plot(*arc.T, color=ORANGE, lw=3)
    plane = foot + 1.3 * radius * np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]])
    draw_patch(axes, plane, SKY, alpha=0.15)
    axes.plot(*np.column_stack([foot, centre]), "o-", color="black", ms=4)
    axes.text(*(centre - [0, 0, 0.2 * radius]), "ball's centre")
    axes.text(*(foot - [0, 0, 0.2 * radius]), "circle's centre", ha="right")
    equal_axes(axes, np.vstack([plane, centre - radius, centre + radius]))
    axes.set(xlabel="sensor x [mm]", ylabel="sensor y [mm]", zlabel="sensor z [mm]")
    axes.locator_params(nbins=4)


def draw_cut_from_beside(axes, radius: float, beside: float) -> None:
    """Draw balls on either side of the scan plane, seen along it: they are cut in the same circle."""
    half = np.sqrt(radius**2 - beside**2)
    for side, style, name in ((1, "-", "s = +1"), (-1, "--", "s = -1")):
        axes.add_patch(plt.Circle((side * beside, 0), radius, fill=False, color="0.4", ls=style))
        axes.plot([side * beside, 0], [0, half], color="0.4", ls=style)
        axes.plot([0, side * beside], [0, 0], color="black", ls=style)
        axes.annotate(name, (side * (beside + 0.55 * radius), 0), ha="center")
    axes.plot([0, 0], [-half, half], color=ORANGE, lw=4)
    axes.axvline(0, color=SKY, lw=1)
    axes.annotate("$r_b$", (0.55 * beside, 0.55 * half), ha="left")
    axes.annotate("$r_d$", (0, 0.5 * half), (-6, 0), textcoords="offset points", ha="right", color=ORANGE)
    axes.annotate("$q_y$", (0.5 * beside, 0), (0, -12), textcoords="offset points", ha="center")
    axes.set(xlabel="sensor y [mm]", ylabel="sensor z [mm]", aspect="equal")
    axes.autoscale_view()
