"""A plan as a picture: where the robot goes. Takes a `plan.design.Plan`."""

import matplotlib.pyplot as plt
import numpy as np

from profilecal.plan.design import Plan
from profilecal.report.figures import BLUE, SKY, draw_frame, draw_patch, equal_axes, use_style


def save_plan(plan: Plan, path) -> None:
    """Write the picture as a PNG file."""
    use_style()
    figure, axes = plt.subplots(figsize=(7, 5.5), layout="constrained", subplot_kw={"projection": "3d"})
    draw_way(axes, plan)
    found, kind = plan.predicted, plan.model.target.kind
    axes.set_title(f"{len(plan.T)} poses over the {kind} (black): {found.mm:.2g} mm and {found.deg:.2g}° predicted")
    figure.savefig(path, dpi=150)
    plt.close(figure)


def draw_way(axes, plan: Plan) -> None:
    """Draw the flange's way and some fields of view in a 3D plot; eye-to-hand, in the flange's frame, where the target
    stands still."""
    R, T = plan.R, plan.T
    fans = field_of_view(plan.model) @ np.swapaxes(R, 1, 2) + T[:, None]
    origins, lines = fans[:, 0], target_lines(plan)
    axes.plot(*origins.T, color=BLUE, lw=0.8, alpha=0.6)
    axes.scatter(*origins.T, color=BLUE, s=8, depthshade=False, label="sensor, on its way")
    few = np.unique(np.linspace(0, len(T) - 1, 5).round().astype(int))
    for k in few:
        draw_patch(axes, fans[k, 1:], SKY, 0.12, "field of view" if k == few[0] else "")
        draw_frame(axes, R[k] @ plan.model.R_sensor, origins[k], 0.06 * np.ptp(fans, axis=(0, 1)).max())
    for line in lines:
        axes.plot(*line.T, color="black", lw=4 if len(lines) == 1 else 1.5, zorder=5)
    equal_axes(axes, np.vstack([origins, fans[few].reshape(-1, 3), *lines]))
    frame = "flange" if plan.model.to_hand else "base"
    axes.set(xlabel=f"{frame} x [mm]", ylabel=f"{frame} y [mm]", zlabel=f"{frame} z [mm]")
    axes.locator_params(nbins=4)
    axes.computed_zorder = False
    axes.legend(loc="upper left", fontsize=8)


def field_of_view(model) -> np.ndarray:
    """The sensor's origin and the corners of its field of view, (5, 3), mm, in the frame that it is fixed to."""
    scanner = model.scanner
    z = np.array([0, scanner.near, scanner.far, scanner.far, scanner.near])
    x = scanner.half_width(z) * [0, -1, -1, 1, 1]
    return np.stack([x, 0 * x, z], axis=1) @ model.R_sensor.T + model.T_sensor


def target_lines(plan: Plan) -> list[np.ndarray]:
    """Polylines (n, 3) of the target, mm, in the frame that it is fixed to."""
    R_view, T_view = plan.model.planes(plan.R, plan.T)
    x, z = np.moveaxis(plan.model.seen(R_view, T_view, 5)[..., None], 2, 0)
    seen = x * R_view[:, None, :, 0] + z * R_view[:, None, :, 2] + T_view[:, None]
    return [np.asarray(line)[:: max(1, len(line) // 40)] for line in plan.model.target.lines(seen.reshape(-1, 3))]
