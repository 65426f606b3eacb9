"""A plan as a picture: where the robot goes, and how many poses it takes. Takes a `plan.Plan`."""

import matplotlib.pyplot as plt
import numpy as np

from profilecal.geometry.poses import inverse
from profilecal.plan.folder import fan, robot_poses, target_lines
from profilecal.plan.plan import Plan
from profilecal.report.figures import BLUE, PURPLE, SKY, draw_frame, draw_patch, equal_axes, use_style

FANS_DRAWN = 5


def plot_plan(plan: Plan) -> plt.Figure:
    """The flange's way and some fields of view over the target, and the predicted deviations over the poses."""
    figure = plt.figure(figsize=(10, 4.8), layout="constrained")
    grid = figure.add_gridspec(1, 2, width_ratios=[1.3, 1])
    draw_way(figure.add_subplot(grid[0], projection="3d"), plan)
    draw_curve(figure.add_subplot(grid[1]), plan)
    return figure


def save_plan(plan: Plan, path) -> None:
    """Write the picture as a PNG file."""
    use_style()
    figure = plot_plan(plan)
    figure.savefig(path, dpi=150)
    plt.close(figure)


def draw_way(axes, plan: Plan) -> None:
    """Draw poses in a 3D plot; eye-to-hand, in the flange's frame, where the target stands still."""
    R, T = robot_poses(plan)
    corners, lines = fan(plan), target_lines(plan)
    if plan.setup.to_hand:
        R, T = inverse(R, T)
    few = np.unique(np.linspace(0, len(T) - 1, FANS_DRAWN).round().astype(int))
    fans = corners @ np.swapaxes(R, 1, 2) + T[:, None]
    where = fans[:, 0]
    axes.plot(*where.T, color=BLUE, lw=0.8, alpha=0.6)
    axes.scatter(*where.T, color=BLUE, s=8, depthshade=False, label="sensor, on its way")
    for k in few:
        draw_patch(axes, fans[k, 1:], SKY, 0.12, "field of view" if k == few[0] else "")
        draw_frame(axes, R[k] @ plan.setup.R_sensor, fans[k, 0], 0.06 * np.ptp(fans, axis=(0, 1)).max())
    for line in lines:
        axes.plot(*line.T, color="black", lw=4 if len(lines) == 1 else 1.5, zorder=5)
    equal_axes(axes, np.vstack([where, fans[few].reshape(-1, 3), *lines]))
    frame = "flange" if plan.setup.to_hand else "base"
    axes.set(xlabel=f"{frame} x [mm]", ylabel=f"{frame} y [mm]", zlabel=f"{frame} z [mm]")
    axes.locator_params(nbins=4)
    axes.set_title(f"{len(T)} poses that see the {plan.setup.target.kind} (black)")
    axes.computed_zorder = False
    axes.legend(loc="upper left", fontsize=8)


def draw_curve(axes, plan: Plan) -> None:
    """Draw the predicted standard deviations over the number of poses."""
    n, mm, deg = np.array(plan.curve).T
    shown = np.maximum(mm / plan.wishes.until[0], deg / plan.wishes.until[1]) < 100  # not what is still open
    for values, limit, unit, colour in (
        (mm, plan.wishes.until[0], "mm", BLUE),
        (deg, plan.wishes.until[1], "°", PURPLE),
    ):
        axes.plot(n[shown], values[shown], "o-", ms=3, color=colour, label=f"worst direction [{unit}]")
        axes.axhline(limit, color=colour, ls=":", lw=1)
    title = f"{len(plan.T)} poses: {plan.predicted.mm:.2g} mm and {plan.predicted.deg:.2g}° predicted"
    axes.set(xlabel="designed poses", ylabel="one standard deviation", yscale="log", title=title)
    axes.legend()
    for ticks in (axes.yaxis.set_major_formatter, axes.yaxis.set_minor_formatter):
        ticks(lambda value, _: f"{value:g}" if f"{value:.0e}"[0] in "125" else "")
