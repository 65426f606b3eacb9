"""The report on a user's own scans: every function takes a `calibrate.Calibration`."""

from dataclasses import dataclass
from html import escape

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from profilecal.geometry.poses import carry
from profilecal.joint.observability import BY_HAND_DEG, BY_HAND_MM, WEAK, name_direction
from profilecal.joint.solve import FALSE_ALARM
from profilecal.report.figures import (
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    RED,
    SKY,
    YELLOW,
    circle_points,
    draw_frame,
    draw_scan,
    equal_axes,
)
from profilecal.scan.conventions import CONVENTIONS, VENDORS, for_controller, from_rotations

FRAMES_DRAWN, SCANS_DRAWN = 24, 8  # flange frames and scan planes in a picture
TARGETS = ("black", PURPLE, YELLOW)  # one colour a scan
PROFILES_DRAWN = 20  # profiles in one figure, so that figures fit on a page
VERDICTS = {
    "ok": ("The scanner's pose is determined", GREEN, "Every direction of it is known to better than 1 mm and 0.5°."),
    "weak": (
        "Solved, but not well enough to rely on",
        ORANGE,
        "Some direction is known no better than 1 mm or 0.5°, another pose fits as well, or the residuals show that "
        "something is wrong. Why, and what to do:",
    ),
    "unobservable": (
        "These measurements cannot determine the scanner's pose",
        RED,
        "Any pose that fits them would be a guess, so none is stated. What to add:",
    ),
}


@dataclass(frozen=True)
class Html:
    """Text for a reader: HTML where it can be shown, and plain."""

    html: str
    plain: str

    def _repr_mimebundle_(self, include=None, exclude=None) -> dict:
        return {"text/plain": self.plain, "text/html": self.html}


def html_table(frame: pd.DataFrame) -> Html:
    """A table without its index that scrolls sideways where the screen is narrow."""
    return Html(f'<div class="scroll">{frame.to_html(index=False, border=0)}</div>', frame.to_string(index=False))


def frame_name(found) -> str:
    """The frame in which the sensor's pose is: "flange", or "base" when the scanner stands still."""
    return "flange" if found.scans[0].mount == "eye-in-hand" else "base"


def verdict(found) -> Html:
    """The status in words, what to do about it, and what else there is to say."""
    title, colour, text = VERDICTS[found.status]
    notes = words(found.messages)
    html = f'<p style="margin:0"><strong style="font-size:1.15em">{title}.</strong> {text}</p>'
    html += notes.html if found.messages else ""
    html = f'<div class="verdict" style="border-left:6px solid {colour};padding:0.6em 1em">{html}</div>'
    return Html(html, "\n".join(filter(None, [f"{title}. {text}", notes.plain])))


def pose_numbers(solution, convention) -> tuple[np.ndarray, np.ndarray]:
    """Position, mm, and orientation in a convention's columns, and the standard deviation of each: (3 + k,) both."""

    def numbers(delta):
        turned = solution.rotation @ Rotation.from_rotvec(delta[3:]).as_matrix()
        return np.r_[solution.translation + solution.rotation @ delta[:3], from_rotations(convention, turned[None])[0]]

    value, step = numbers(np.zeros(6)), 1e-6
    change = np.array([[numbers(sign * step * axis) - value for sign in (1, -1)] for axis in np.eye(6)])
    smooth = np.abs(change[:, :, 3:]).sum(axis=2).argmin(axis=1)  # an angle may jump by a turn on the other side
    J = change[np.arange(6), smooth].T / (step * np.where(smooth, -1, 1))
    return value, np.sqrt(np.diag(J @ solution.covariance @ J.T))


def convention_of(found):
    """The notation of the robot that the poses come from; FANUC's angles where that is a matrix."""
    convention = next(c for c in CONVENTIONS if c.name == found.scans[0].convention)
    return convention if len(convention.columns) < 9 else next(c for c in CONVENTIONS if c.name == "FANUC angles")


def pose_table(found) -> Html:
    """The sensor's pose in the notation of the robot that the poses come from, each number with its uncertainty."""
    if found.status == "unobservable":
        return Html("<p>No pose to state.</p>", "No pose to state.")
    convention = convention_of(found)
    value, sd = pose_numbers(found.solution, convention)
    angle = {"quaternion": "1", "rotation vector": "rad"}.get(convention.name, "deg")
    names = [c.upper() if convention.sequence and len(c) == 1 else c for c in convention.columns]
    units = ["mm"] * 3 + [angle] * len(names)
    rows = {
        "": ["X", "Y", "Z", *names],
        "value": [f"{v:.{places(u)}f}" for v, u in zip(value, units, strict=True)],
        "standard deviation": [f"{v:.2g}" for v in sd],
        "95 %": [f"±\u00a0{1.96 * v:.2g}" for v in sd],
        "unit": units,
    }
    return html_table(pd.DataFrame(rows))


def places(unit: str) -> int:
    """Decimals that a robot's operator reads."""
    return {"mm": 3, "deg": 4}.get(unit, 6)


def pose_words(found) -> Html:
    """How the numbers of `pose_table` are meant, and what they mean for a measured point."""
    if found.status == "unobservable":
        return Html("", "")
    s, convention = found.solution, convention_of(found)
    meant = {"ZYX": "R = Rz(A) Ry(B) Rx(C)", "XYZ": "R = Rx(alpha) Ry(beta) Rz(gamma)"}
    rule = meant.get(convention.sequence, "R = Rz(R) Ry(P) Rx(W)")
    if convention.name in ("quaternion", "rotation vector"):
        rule = f"a {convention.name}"
    seen = np.concatenate([np.asarray(o.points).reshape(-1, 2) for o in found.observed])
    x, z = np.nanmean(seen, axis=0).round() + 0.0  # not -0
    J = np.column_stack([np.eye(3), np.cross(np.eye(3), [x, 0, z]).T])  # δ moves a point p by ρ + φ × p
    placed = np.sqrt(np.trace(J @ s.covariance @ J.T))
    mm, deg = ("{:.2g}, {:.2g} and {:.2g}".format(*sd) for sd in (s.translation_sd_mm, s.rotation_sd_deg))
    lines = [
        f"Position of the sensor's origin and orientation of its axes in the {frame_name(found)} frame; {rule}.",
        f"Along the sensor's own x, y, z the standard deviations are {mm} mm, about them {deg}°.",
        f"A point in the middle of the scans (x = {x:.0f}, z = {z:.0f} mm) is placed within {placed:.2g} mm rms by "
        "this calibration; the robot's and the scanner's own errors come on top.",
    ]
    return Html("".join(f"<p>{line}</p>" for line in lines), "\n".join(lines))


def facts_table(found) -> Html:
    """What was scanned, how much of it counts, and how well it fits."""
    s, rows = found.solution, []
    for scan, seen in zip(found.scans, found.seen, strict=True):
        name = f"{scan.title or scan.kind}: {scan.description}"
        groups = len(np.unique(scan.group)) if scan.group is not None else len(scan.labels)
        rows.append(("Scan", f"{name}; {len(scan.labels)} poses in {groups} orientations, target found in {len(seen)}"))
    mounts = {"eye-in-hand": "on the flange (eye-in-hand)", "eye-to-hand": "fixed in the cell (eye-to-hand)"}
    rows += [("Scanner", mounts[found.scans[0].mount])]
    if s:
        method = {"joint": "joint maximum likelihood", "closed-form": "closed form, as the papers do it"}[found.method]
        rows += [
            ("Method", method),
            ("Poses", f"{len(found.labels(rejected=False))} used, {len(found.labels(rejected=True))} rejected"),
            ("Scanner noise", f"{s.noise_mm:.3g} mm, {s.level.how}"),
            ("Residuals", f"{s.rms_mm:.3g} mm rms; χ²/dof = {s.chi2_per_dof:.3g} (1: as the noise explains)"),
        ]
    return html_table(pd.DataFrame(rows, columns=["", " "]))


def plot_robot(found) -> plt.Figure:
    """The flange's poses, the scan planes and the targets where the calibration puts them, in the base frame."""
    figure = plt.figure(figsize=(5.6, 5.2))
    axes = figure.add_subplot(projection="3d")
    known, on_flange = found.status != "unobservable", found.scans[0].mount == "eye-in-hand"
    origins = np.concatenate([scan.T_base_flange for scan in found.scans])
    size = 0.08 * np.ptp(origins, axis=0).max() + 5
    drawn = [origins]
    if known and not on_flange:
        s = found.solution
        draw_sensor(axes, s.rotation, s.translation, depth_of(found.observed), "scan plane")
        drawn.append(s.translation[None])
    for k, (scan, observed) in enumerate(zip(found.scans, found.observed, strict=True)):
        R, T = scan.R_base_flange, scan.T_base_flange
        few = np.unique(np.linspace(0, len(T) - 1, max(1, FRAMES_DRAWN // len(found.scans))).round().astype(int))
        axes.scatter(*T.T, color="0.35", s=6, depthshade=False, label="" if k else f"flange, {len(origins)} poses")
        for i in few:
            draw_frame(axes, R[i], T[i], size)
        if not known:
            continue
        target = found.solution.placements[k]
        if on_flange:
            for j, i in enumerate(few[:: -(-len(few) * len(found.scans) // SCANS_DRAWN)]):
                rotation, origin = R[i] @ found.solution.rotation, T[i] + R[i] @ found.solution.translation
                draw_scan(axes, rotation, origin, depth_of([observed]), SKY, "" if j or k else "scan plane")
            lines = target_lines(target, found.solution, observed)
            drawn += [draw_lines(axes, lines, TARGETS[k % 3], f"{scan.kind}, where the scans place it")]
        else:
            lines = target_lines(target, found.solution, observed)
            for j, i in enumerate(few):
                moved = [line @ R[i].T + T[i] for line in lines]
                label = "" if j or k else f"{scan.kind}, carried by the flange"
                drawn += [draw_lines(axes, moved, TARGETS[k % 3], label, width=0.8)]
    equal_axes(axes, np.concatenate(drawn))
    axes.set(xlabel="base x [mm]", ylabel="base y [mm]", zlabel="base z [mm]")
    axes.locator_params(nbins=5)
    figure.legend(loc="outside lower center", ncols=2)
    return figure


def draw_sensor(axes, rotation, origin, depth: float, label: str) -> None:
    """A sensor frame with its scan plane."""
    draw_frame(axes, rotation, origin, 0.35 * depth)
    draw_scan(axes, rotation, origin, depth, SKY, label)


def depth_of(observed) -> float:
    """Middle depth of what was seen, mm."""
    return float(np.nanmedian(np.concatenate([np.asarray(o.points)[..., 1].ravel() for o in observed])))


def draw_lines(axes, lines, colour: str, label: str, width: float = 3.0) -> np.ndarray:
    """Draw polylines (n, 3) in a 3D plot; return their points."""
    for k, line in enumerate(lines):
        axes.plot(*line.T, color=colour, lw=width if len(lines) == 1 else 1, label=label if k == 0 else "")
    return np.concatenate(lines)


def target_lines(target, solution, observed) -> list[np.ndarray]:
    """A target as polylines (n, 3), as far as it was seen."""
    x, z = np.moveaxis(np.asarray(observed.points)[0], -1, 0)
    seen = np.stack([x, np.zeros_like(x), z], axis=-1) @ solution.rotation.T + solution.translation
    in_base = carry(observed.R_flange[0][:, None], observed.T_flange[0][:, None], seen)
    return target.lines(in_base.reshape(-1, 3))


def chance_limits(found) -> list[np.ndarray]:
    """For each scan, the residual (P,) over the noise that a good pose exceeds so seldom that none of them should."""
    total = sum(map(len, found.seen))
    counts = [o.target.rows * np.isfinite(o.points[0, :, :, 0]).sum(axis=1) for o in found.observed]
    return [np.sqrt(chi2.isf(FALSE_ALARM / total, count) / count) for count in counts]


def plot_residuals(found) -> plt.Figure | None:
    """Each pose's residual over the noise, by scan, with the means of rotation groups and the poses rejected."""
    if not found.solution:
        return None
    figure, rows = plt.subplots(len(found.scans), figsize=(5.6, 0.6 + 2.5 * len(found.scans)), squeeze=False)
    parts = zip(rows[:, 0], found.scans, found.seen, found.solution.normalised, found.solution.rejected, strict=True)
    for (axes, scan, seen, size, bad), limit in zip(parts, chance_limits(found), strict=True):
        group = scan.group[seen] if scan.group is not None else np.arange(len(seen))
        top = 1.15 * max(np.append(size[~bad], limit))
        even = np.unique(group, return_inverse=True)[1] % 2 == 0
        axes.bar(seen[~bad], size[~bad], color=np.where(even[~bad], BLUE, SKY), width=0.8)
        axes.scatter(seen[bad], np.minimum(size[bad], 0.97 * top), marker="x", color=RED, zorder=3, label="rejected")
        for g in np.unique(group):
            kept = (group == g) & ~bad
            if kept.sum() > 1:
                mean = np.sqrt(np.mean(size[kept] ** 2))
                axes.plot([seen[kept][0] - 0.4, seen[kept][-1] + 0.4], [mean, mean], color="black", lw=1.5)
        axes.plot(seen, limit, color=RED, lw=1, ls="--", label="limit of chance")
        axes.axhline(1, color="0.5", lw=0.8, ls=":")
        axes.plot([], [], color="black", lw=1.5, label="rms of a group")
        axes.set(xlabel="pose", ylabel="residual / noise", ylim=(0, top), title=scan.title if len(rows) > 1 else "")
        names = [shorten(label, 8) for label in scan.labels]
        ticks = seen[:: -(-len(seen) * max(map(len, names)) // 40)]
        axes.set_xticks(ticks, [names[i] for i in ticks])
    handles = [handle for handle in rows[0, 0].get_legend_handles_labels()[0] if handle.get_label()[0] != "_"]
    figure.legend(handles=handles, loc="outside upper center", ncols=3)
    return figure


def plot_left_out(left) -> plt.Figure | None:
    """How well each orientation is predicted by the others (`leave_out.LeftOut`), and how well to expect it."""
    shown = np.flatnonzero(np.isfinite(left.rms_mm))
    if not len(shown):
        return None
    figure, axes = plt.subplots(figsize=(5.6, 2.6))
    colours = np.where(left.doubted[shown], RED, BLUE)
    axes.bar(np.arange(len(shown)), left.rms_mm[shown], color=colours, width=0.75, label="found")
    axes.scatter(np.arange(len(shown)), left.expected_mm[shown], marker="_", s=120, color="black", label="expected")
    names = [shorten(left.poses[g][0], 8) for g in shown]
    ticks = np.arange(len(shown))[:: -(-len(shown) * max(map(len, names)) // 40)]
    axes.set_xticks(ticks, [names[i] for i in ticks])
    axes.set(xlabel="orientation left out, by its first pose", ylabel="predicted to, rms [mm]")
    figure.legend(loc="outside upper center", ncols=2)
    return figure


def words(sentences) -> Html:
    """Sentences as a list."""
    listed = [sentence[0].upper() + sentence[1:] + "." * (sentence[-1] not in ".?!") for sentence in sentences]
    html = "".join(f"<li>{escape(sentence)}</li>" for sentence in listed)
    return Html(f"<ul>{html}</ul>", "\n".join(f"- {sentence}" for sentence in listed))


def shorten(text: str, length: int) -> str:
    """The text, cut where it is longer."""
    return text if len(text) <= length else text[: length - 1] + "…"


def rejected_table(found) -> Html:
    """The poses that do not count, and why."""
    rows = []
    if found.solution:
        parts = zip(found.scans, found.seen, found.solution.normalised, found.solution.rejected, strict=True)
        for (scan, seen, size, bad), limit in zip(parts, chance_limits(found), strict=True):
            for i, value, most in zip(seen[bad], size[bad], limit[bad], strict=True):
                alone = f"{value:.1f} times the noise; chance explains up to {most:.1f}"
                crowd = f"most of its group is off; itself {value:.1f} times the noise"
                rows.append((scan.title, scan.labels[i], alone if value > most else crowd))
    for scan, seen in zip(found.scans, found.seen, strict=True):
        missed = np.setdiff1d(np.arange(len(scan.labels)), seen)
        why = reasons_of(scan)
        rows += [(scan.title, scan.labels[i], why.get(i, "nothing measured")) for i in missed]
    if not rows:
        return Html("<p>None: every pose counts.</p>", "None: every pose counts.")
    frame = pd.DataFrame(rows, columns=["scan", "pose", "why"])
    return html_table(frame if len(found.scans) > 1 else frame.drop(columns="scan"))


def reasons_of(scan) -> dict[int, str]:
    """Why the target was not found, by pose, where the scan holds raw profiles."""
    if scan.measured != "profiles":
        return {}
    return {i: f.reason for i, f in enumerate(scan.target.features(scan.values, scan.sizes)) if f.reason}


def plot_view(found) -> plt.Figure:
    """What was seen of the targets, in the scan plane: the part of the field of view that the measurements cover."""
    figure, axes = plt.subplots(figsize=(5.6, 4.2))
    for k, (scan, o) in enumerate(zip(found.scans, found.observed, strict=True)):
        colour, points = (BLUE, GREEN, ORANGE, PURPLE)[k % 4], np.asarray(o.points)[0]
        name = scan.title if len(found.scans) > 1 else ""
        if o.kind == "disk":
            lines = np.concatenate([points, np.full_like(points[:, :1], np.nan)], axis=1).reshape(-1, 2)
            axes.plot(*lines.T, color=colour, lw=0.8, alpha=0.6, label=name)
        elif scan.measured == "arcs":
            for x, z, r in (scan.values[i][0] for i in found.seen[k]):
                angle = np.radians(np.linspace(-60, 60, 40))
                axes.plot(x + r * np.sin(angle), z - r * np.cos(angle), color=colour, lw=0.8, alpha=0.6)
        else:
            axes.scatter(*points.reshape(-1, 2).T, s=8 if o.kind == "edge" else 1, color=colour, label=name, alpha=0.7)
    axes.set(xlabel="sensor x [mm]", ylabel="sensor z, depth [mm]", aspect="equal")
    axes.invert_yaxis()
    if len(found.scans) > 1:
        figure.legend(loc="outside upper center")
    return figure


def plot_profiles(scan, rejected=()) -> list[plt.Figure]:
    """Every profile of a scan with what was found in it, PROFILES_DRAWN to a figure, all at one scale.

    `rejected`: labels of the poses that the calibration rejects. No figures where the scan holds no raw profiles.
    """
    if scan.measured != "profiles":
        return []
    features = scan.target.features(scan.values, scan.sizes)
    valid = [values[np.isfinite(values).all(axis=1)] for values in scan.values]
    width, height = 1.2 * np.percentile([np.ptp(values, axis=0) for values in valid if len(values)], 90, axis=0)
    cell = np.array([width, np.clip(height, 0.4 * width, 0.75 * width)])
    figures = []
    for first in range(0, len(features), PROFILES_DRAWN):
        page = range(first, min(first + PROFILES_DRAWN, len(features)))
        figures.append(profile_page(scan, features, page, cell, set(rejected)))
    return figures


def profile_page(scan, features, page, cell, rejected, columns: int = 4) -> plt.Figure:
    """One figure of `plot_profiles`: all in one set of axes, each profile moved to its place, which draws fast."""
    step, rows = cell * [1.05, -1.35], -(-len(page) // columns)
    figure, axes = plt.subplots(figsize=(5.6, 5.6 / columns * (rows + 0.2) * step[1] / -step[0]))
    for k, i in enumerate(page):
        feature, corner = features[i], step * [k % columns, k // columns]
        note = "not found" if feature.reason else "rejected" if scan.labels[i] in rejected else ""
        axes.add_patch(plt.Rectangle(corner - cell / 2, *cell, fill=False, ec="0.8", lw=0.6))
        text = f"{shorten(scan.labels[i], 10)} {note}".strip()
        axes.text(corner[0], corner[1] + 0.54 * cell[1], text, color=RED if note else "0.2", ha="center", fontsize=8)
        draw_profile(axes, scan, scan.values[i], feature, corner, cell)
    bar, left = 10 ** np.floor(np.log10(cell[0] / 2)), -cell[0] / 2
    bottom = (rows - 0.5) * step[1] + 0.05 * cell[1]
    axes.plot([left, left + bar], [bottom] * 2, color="black", lw=2)
    axes.text(left + 1.15 * bar, bottom, f"{bar:g} mm", va="center", fontsize=8)
    axes.set(
        aspect="equal",
        xlim=(1.02 * left, step[0] * (columns - 1) - 1.02 * left),
        ylim=(bottom - 0.1 * cell[1], 0.8 * cell[1]),
    )
    axes.axis("off")
    return figure


def draw_profile(axes, scan, values, feature, corner, cell) -> None:
    """One profile, depth downwards, within a cell around `corner`: the points that its feature rests on in blue."""
    there = np.isfinite(values).all(axis=1)
    if not there.any():
        return
    used = np.asarray(feature.used, dtype=bool) & there
    shown = values[used] if used.any() else values[there]
    middle = (shown.min(axis=0) + shown.max(axis=0)) / 2
    inside = there & (np.abs(values - middle) < cell / 2).all(axis=1)
    for points, colour in ((values[inside & ~used], "0.6"), (values[inside & used], BLUE)):
        axes.plot(*((points - middle) * [1, -1] + corner).T, ".", ms=1.2, color=colour, rasterized=True)
    if not feature.reason and scan.kind in ("edge", "disk"):
        axes.plot(*((feature.points - middle) * [1, -1] + corner).T, "o", ms=5, mfc="none", mec=RED, mew=1.3)


def profile_words(found) -> Html:
    """The key to `plot_profiles`, or what was there instead of profiles."""
    raw = [scan for scan in found.scans if scan.measured == "profiles"]
    if raw:
        marks = {"ball": "the points taken for the ball", "plane": "the points taken for the plane"}
        text = (
            "Each profile as the scanner saw it, depth downwards, all at one scale, around the feature. Blue: "
            + " or ".join(sorted({marks.get(scan.kind, "the points that the feature rests on") for scan in raw}))
        )
        text += "; red circle: the feature found." if any(s.kind not in marks for s in raw) else "."
    else:
        kinds = " and ".join(sorted({scan.measured for scan in found.scans}))
        text = f"This scan holds {kinds} instead of raw profiles; the features were found before it was written."
    return Html(f"<p>{text}</p>", text)


def plot_directions(found) -> plt.Figure | None:
    """The direction in which the sensor's pose is known worst, drawn at the sensor, and all six on one scale."""
    if not found.solution:
        return None
    s = found.solution.observability
    figure = plt.figure(figsize=(5.6, 6.0))
    grid = figure.add_gridspec(2, 1, height_ratios=(1.2, 1))
    view, scale = figure.add_subplot(grid[0], projection="3d"), figure.add_subplot(grid[1])
    draw_frame(view, np.eye(3), np.zeros(3), 0.5)
    for axis, name in zip(0.6 * np.eye(3), "xyz", strict=True):
        view.text(*axis, name, ha="center", va="center")
    draw_scan(view, np.eye(3), np.zeros(3), 1.3, SKY, "scan plane")
    draw_direction(view, s.directions[0])
    equal_axes(view, np.array([[-0.8, -0.8, -0.6], [0.8, 0.8, 1.0]]))
    view.set_box_aspect((1, 1, 1), zoom=1.7)
    view.set_axis_off()
    view.view_init(elev=-155, azim=-60)
    view.legend(loc="upper left", fontsize=9)

    sd, low = np.minimum(s.sd, 30), 10 ** np.floor(np.log10(min(s.sd[-1], 0.01)))
    for start, end, colour in ((low, WEAK, GREEN), (WEAK, 1, ORANGE), (1, 100, RED)):
        scale.axvspan(start, end, color=colour, alpha=0.15, lw=0)
    scale.barh(np.arange(1, 7), sd, color=[RED if v >= 1 else ORANGE if v >= WEAK else GREEN for v in s.sd], height=0.6)
    scale.set(xscale="log", xlim=(low, 50), ylim=(6.6, 0.0), yticks=range(1, 7), ylabel="direction, worst first")
    ticks = [v for v in (0.001, 0.01, 0.1, 1, 10) if v >= low]
    scale.set_xticks(ticks, [f"{BY_HAND_MM * v:g} mm\n{BY_HAND_DEG * v:g}°" for v in ticks])
    for place, text in ((np.sqrt(low * WEAK), "good"), (np.sqrt(WEAK), "weak"), (np.sqrt(50), "unknown")):
        scale.text(place, 0.3, text, ha="center", va="center", fontsize=9)
    scale.set_xlabel("standard deviation")
    return figure


def draw_direction(axes, direction) -> None:
    """A direction (6,) of a pose in a 3D plot: a straight arrow for its shift, a bent one for its turn."""
    shift, turn = direction[:3], direction[3:]
    if shift @ shift > 0.2:
        axes.quiver(0, 0, 0, *(0.8 * shift), color="black", lw=2.5, label="shift")
        axes.quiver(0, 0, 0, *(-0.8 * shift), color="black", lw=2.5)
    if turn @ turn > 0.2:
        axis = turn / np.linalg.norm(turn)
        axes.plot(*np.outer(axis, [-0.9, 0.9]), color=PURPLE, lw=1, ls="--")
        around = circle_points(0.75 * axis, axis, 0.2)[:70]
        axes.plot(*around.T, color=PURPLE, lw=2.5, label="turn")
        axes.quiver(*around[-1], *(3 * (around[-1] - around[-2])), color=PURPLE, lw=2.5, arrow_length_ratio=2)


def directions_table(found) -> Html:
    """The six directions of the sensor's pose in words, worst first."""
    if not found.solution:
        return Html("<p>There are fewer measurements than unknowns.</p>", "There are fewer measurements than unknowns.")
    s = found.solution.observability
    words = [name_direction(d, found.solution.rotation, frame_name(found)) for d in s.directions]
    size = [f"{sd * BY_HAND_MM:.2g} mm or {sd * BY_HAND_DEG:.2g}°" if sd < 10 else "unknown" for sd in s.sd]
    frame = pd.DataFrame({" ": range(1, 7), "direction of the sensor's pose": words, "standard deviation": size})
    return html_table(frame)


def export_block(found) -> Html:
    """The sensor's pose as each controller takes it."""
    if found.status == "unobservable":
        return Html("<p>Nothing to export.</p>", "Nothing to export.")
    lines = {vendor: for_controller(vendor, found.solution.T_flange_sensor, frame_name(found)) for vendor in VENDORS}
    html = "".join(f"<h4>{CONTROLLERS[vendor]}</h4><pre>{escape(line)}</pre>" for vendor, line in lines.items())
    return Html(html, "\n".join(f"{CONTROLLERS[vendor]}\n{line}\n" for vendor, line in lines.items()))


CONTROLLERS = {
    "abb": "ABB (RAPID)",
    "kuka": "KUKA (KRL)",
    "ur": "Universal Robots (URScript; metres, radians)",
    "fanuc": "FANUC",
    "staubli": "Stäubli (VAL 3)",
    "ros": "ROS 2 (metres)",
    "matrix": "Matrix, mm",
}
