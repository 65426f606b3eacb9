"""The disk paper's sketches (Figs 1 to 13), drawn from a scan. The scanner is above: z̄ points down."""

from dataclasses import dataclass

import numpy as np

from profilecal.closed_form.disk import SensingData, sensing_data
from profilecal.geometry.poses import circle_around, rotations
from profilecal.papers.disk_study import DiskScans
from profilecal.report import figures

NAMES = ("1", "2", "3", "4", "5")


@dataclass(frozen=True)
class Drawn:
    """One scan of a disk without noise, seen along its chords: y across the scan plane, z̄ down, from the centre q."""

    scans: DiskScans  # its first scan is the one
    tips: np.ndarray  # (m, 2, 2) mm, x and z of the sensor frame
    data: SensingData  # without a leading axis
    radius: float  # mm

    @classmethod
    def of(cls, scans: DiskScans, m: int) -> "Drawn":
        """Of m chords."""
        tips = scans.tips(m)[0]
        data = sensing_data(tips, scans.T_start[0], scans.T_end[0], scans.s[0], scans.disk.radius)
        return cls(scans, tips, data, scans.disk.radius)

    @property
    def rotated(self) -> np.ndarray:
        """R_θ (2, 2): from x and z of the sensor frame to x̄ and z̄."""
        (cos, sin) = self.data.direction
        return np.array([[cos, sin], [-sin, cos]])

    @property
    def across(self) -> np.ndarray:
        """(2,) unit vector from q1 to q2."""
        return np.array([self.scans.s[0] * np.sin(self.data.alpha), np.cos(self.data.alpha)])

    @property
    def at(self) -> np.ndarray:
        """(5,) q1 to q5 along their diameter, as fractions of the radius."""
        return np.array([-1, 1, 0, *self.data.extent])

    @property
    def q(self) -> np.ndarray:
        """(5, 2) mm."""
        return self.radius * self.at[:, None] * self.across

    @property
    def way(self) -> np.ndarray:
        """(2,) the motion, for each mm of y."""
        sensor = (self.scans.R_tcp[0] @ self.scans.R_sensor).T @ (self.scans.T_end[0] - self.scans.T_start[0])
        return np.array([1.0, self.rotated[1] @ sensor[[0, 2]] / sensor[1]])

    def projected(self, points) -> np.ndarray:
        """Points (..., 2) carried along the motion onto the first scan plane."""
        points = np.asarray(points)
        return points - (points[..., :1] - self.q[3, 0]) * self.way

    def ellipse(self, count: int = 200) -> np.ndarray:
        """(count, 2) mm, x̄ and z̄."""
        angle, e = np.linspace(0, 2 * np.pi, count)[:, None], self.data.e
        return e[2] + self.radius * np.cos(angle) * [1, 0] + np.sin(angle) * (e[1] - e[0]) / 2


def note(axes, text: str, at, offset, colour: str = "black") -> None:
    """A label that no line crosses, `offset` points away."""
    box = {"facecolor": "white", "edgecolor": "none", "pad": 0.8, "alpha": 0.85}
    place = {"xytext": offset, "textcoords": "offset points", "ha": "center", "va": "center"}
    axes.annotate(text, at, **place, color=colour, bbox=box, fontsize=9)


def arrow(axes, start, end, colour: str = "black", width: float = 0.8) -> None:
    """An arrow between two points of a plot."""
    axes.annotate("", end, start, arrowprops={"arrowstyle": "->", "color": colour, "lw": width, "shrinkA": 0})


def beside(height) -> list:
    """Where the five points' labels go, if their heights, downwards, are these: outside the ends, else to the right."""
    up = 11 * np.sign(height[1] - height[0])
    return [(0, up), (0, -up), (14, 0), (14, 0), (14, 0)]


def side_view(axes, drawn: Drawn, title: str) -> None:
    """The disk edge-on, with the axes of all such views."""
    axes.plot(*np.outer(drawn.across, [-drawn.radius, drawn.radius]), color="black", lw=2.5)
    axes.set(xlabel="y, across the scan plane [mm]", ylabel="z̄ [mm]", aspect="equal", anchor="N", title=title)
    axes.invert_yaxis()


def scene(axes, drawn: Drawn) -> None:
    """Scanner, first and last scan plane, disk, chords and motion, in 3D."""
    scans, (first, last) = drawn.scans, (figures.BLUE, figures.ORANGE)
    rotation = scans.R_tcp[0] @ scans.R_sensor
    shift = scans.R_tcp[0] @ scans.T_sensor
    depth = drawn.tips[..., 1].max() + 0.3 * drawn.radius
    rim = circle_around(scans.disk.centre, scans.disk.normal, drawn.radius)
    figures.draw_patch(axes, rim, figures.SKY, alpha=0.5)
    origins = np.linspace(scans.T_start[0], scans.T_end[0], len(drawn.tips)) + shift
    for tips, origin in zip(drawn.tips, origins, strict=True):
        axes.plot(*(origin + tips @ rotation[:, [0, 2]].T).T, color="black", lw=1)
    for origin, colour, name in ((origins[0], first, r"$\bar\pi$"), (origins[-1], last, r"$\tilde\pi$")):
        figures.draw_scan(axes, rotation, origin, depth, colour)
        _box(axes, rotation, origin, 0.5 * drawn.radius, colour)
        axes.text(*(origin + depth * (rotation[:, 2] + 0.56 * rotation[:, 0])), name, color=colour, fontsize=13)
    length = 0.7 * drawn.radius
    figures.draw_frame(axes, rotation, origins[0], length)
    for axis, name in zip(rotation.T, "xyz", strict=True):
        axes.text(*(origins[0] + 1.2 * length * axis), name, ha="center", va="center")
    axes.quiver(*origins[0], *(origins[-1] - origins[0]), color=figures.RED, lw=2.5, arrow_length_ratio=0.2)
    above = 0.45 * drawn.radius * rotation[:, 2]
    axes.text(*(origins.mean(axis=0) - above), "M", color=figures.RED, fontsize=12, fontweight="bold")
    axes.scatter(*scans.disk.centre, color="black", s=25, depthshade=False)
    axes.text(*(scans.disk.centre + 0.12 * drawn.radius), "q", fontsize=12)
    figures.equal_axes(axes, np.vstack([rim, origins, origins[[0, -1]] + depth * rotation[:, 2]]))
    axes.set_box_aspect(None, zoom=1.45)
    axes.set_axis_off()
    axes.view_init(14, -28)


def _box(axes, rotation, origin, side: float, colour: str) -> None:
    """A scanner's housing: behind its origin, as wide as `side`."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.2, 0.2) for z in (-0.6, 0)]) * side
    corners = origin + corners @ rotation.T
    for face in ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)):
        figures.draw_patch(axes, corners[list(face)], colour, alpha=0.5)


def side_of_motion(axes, drawn: Drawn) -> None:
    """Fig. 5: which way the motion goes through the scan plane."""
    side_view(axes, drawn, f"s = {drawn.scans.s[0]:+.0f}")
    note(axes, "disk", 0.4 * drawn.radius * drawn.across, (0, -11))
    r, (first, last) = drawn.radius, drawn.q[3:, 0]
    for y, colour, name in ((first, figures.BLUE, r"$\bar\pi$"), (last, figures.ORANGE, r"$\tilde\pi$")):
        axes.plot([y, y], [-1.3 * r, 1.2 * r], color=colour, lw=1.5)
        note(axes, name, (y, 1.2 * r), (0, -8), colour)
    start = np.array([first, -0.9 * r])
    end = start + (last - first) * drawn.way
    arrow(axes, start, end, figures.RED, 2)
    note(axes, "M", (start + end) / 2, (0, 10), figures.RED)
    arrow(axes, (first, 0.9 * r), (first + 0.7 * r, 0.9 * r), figures.GREEN, 2)
    note(axes, "+y", (first + 0.35 * r, 0.9 * r), (0, -9), figures.GREEN)
    axes.set(xlim=(-1.9 * r, 1.9 * r), ylim=(1.6 * r, -1.9 * r))


def one_chord(figure, drawn: Drawn, turns_deg) -> None:
    """Fig. 8: disks turned about the first chord, by `turns_deg`; all of them show that chord."""
    scans = drawn.scans
    rotation = scans.R_tcp[0] @ scans.R_sensor
    origin = scans.T_start[0] + scans.R_tcp[0] @ scans.T_sensor
    chord = origin + drawn.tips[0] @ rotation[:, [0, 2]].T
    axis = (chord[1] - chord[0]) / np.linalg.norm(chord[1] - chord[0])
    space, flat = figure.add_subplot(1, 2, 1, projection="3d"), figure.add_subplot(1, 2, 2)
    colours = (figures.SKY, figures.ORANGE, figures.GREEN, figures.PURPLE)
    seen, middle = [], drawn.q[3]
    for turn, colour in zip(turns_deg, colours, strict=False):
        R = rotations(np.radians(turn) * axis)
        rim = chord[0] + (circle_around(scans.disk.centre, scans.disk.normal, drawn.radius) - chord[0]) @ R.T
        figures.draw_patch(space, rim, colour, alpha=0.4)
        space.scatter(*rim[:-1].mean(axis=0), color=colour, s=30, depthshade=False)
        seen.append(rim)
        # about +x̄ the sensor's y turns to z̄
        c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
        turned = np.array([[c, -s], [s, c]])
        ends = middle + (np.outer([-drawn.radius, drawn.radius], drawn.across) - middle) @ turned.T
        flat.plot(*ends.T, color=colour, lw=3, label=f"disk turned by {turn:g}°")
        centre = middle - turned @ middle
        flat.plot(*centre, "o", color=colour, ms=9, mec="black")
        outward = 18 * (centre - middle) / np.linalg.norm(middle)
        note(flat, "q", centre, outward[::-1])
    circle = np.linspace(0, 2 * np.pi, 200)
    ring = np.linalg.norm(middle) * np.array([np.cos(circle), np.sin(circle)])
    flat.plot(*(middle[:, None] + ring), color="0.5", ls="--", label="where q may be")
    flat.axvline(middle[0], color=figures.BLUE, lw=1.5)
    flat.plot(*middle, "s", color="black", ms=7)
    note(flat, "chord", middle, (26, 10))
    flat.set(
        xlabel="y, across the scan plane [mm]",
        ylabel="z̄ [mm]",
        aspect="equal",
        anchor="N",
        title="seen along the chord",
    )
    flat.invert_yaxis()
    flat.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1, 1))
    space.plot(*chord.T, color="black", lw=4, zorder=10)
    figures.draw_scan(space, rotation, origin, drawn.tips[..., 1].max() + 0.3 * drawn.radius, figures.BLUE)
    figures.equal_axes(space, np.vstack([*seen, origin]))
    space.set_box_aspect(None, zoom=1.3)
    space.set_axis_off()
    space.computed_zorder = False
    space.view_init(14, -28)
    space.set_title("the scanner sees the same chord")


def chord_projection(axes, drawn: Drawn) -> None:
    """Fig. 9(b): scan planes, where they cut the disk, and the projections onto the first plane."""
    side_view(axes, drawn, "each reading is a projection along M")
    points = np.linspace(drawn.q[3], drawn.q[4], len(drawn.tips))
    for k, (point, onto) in enumerate(zip(points, drawn.projected(points), strict=True)):
        axes.axvline(point[0], color=figures.RED, lw=0.7, label="scan planes" if k == 0 else None)
        arrow(axes, point, onto, "0.4")
        axes.plot(*point, "o", color="black", ms=5, label="chords on the disk" if k == 0 else None)
        axes.plot(*onto, "o", color=figures.BLUE, ms=5, label="as the scanner reads them" if k == 0 else None)
    axes.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=3, handletextpad=0.2)


def recorded_ellipse(axes, drawn: Drawn) -> None:
    """The recorded chords, their ellipse, and the disk in its true shape."""
    angle = np.linspace(0, 2 * np.pi, 200)
    centre = drawn.data.e[2]
    axes.plot(*(centre[:, None] + drawn.radius * np.array([np.cos(angle), np.sin(angle)])), color="0.6", ls=":")
    axes.plot(*drawn.ellipse().T, color=figures.SKY, lw=2)
    for tips in drawn.tips @ drawn.rotated.T:
        axes.plot(*tips.T, color=figures.BLUE, lw=1, marker="o", ms=3)
    note(axes, "disk, face-on", centre + drawn.radius * np.array([0.71, 0.71]), (18, -8), "0.4")
    axes.set(xlabel="x̄ [mm]", ylabel="z̄ [mm]", aspect="equal", anchor="N", title="the readings lie on one ellipse")
    axes.invert_yaxis()


def noisy_middles(figure, drawn: Drawn, noisy, fitted) -> None:
    """Fig. 10, and what the fit makes of it: noisy tips (m, 2, 2), `fitted` with centre and shape, sensor frame."""
    left, right = figure.subplots(1, 2, sharey=True)
    R, true = drawn.rotated, drawn.tips @ drawn.rotated.T
    seen, height = noisy @ R.T, true[:, 0, 1]
    off = seen - true
    left.axvline(0, color="0.5", ls="--", label="true line e1 e2")
    left.plot(off[..., 0].mean(axis=1), height, "o", color=figures.BLUE, ms=4, label="middles of the chords")
    centre, S = R @ fitted.centre, R @ fitted.shape @ R.T
    for side, colour, name in ((0, figures.GREEN, "first tips"), (1, figures.PURPLE, "second tips")):
        inside = np.clip(1 - (seen[:, side, 1] - centre[1]) ** 2 / S[1, 1], 0, None)
        half = np.sqrt((S[0, 0] - S[0, 1] ** 2 / S[1, 1]) * inside)
        on_fit = centre[0] + S[0, 1] / S[1, 1] * (seen[:, side, 1] - centre[1]) + (2 * side - 1) * half
        right.plot(off[:, side, 0], height, "o", color=colour, ms=4, label=name)
        right.plot(on_fit - true[:, side, 0], height, "-", color=colour, lw=2, label=f"{name}, fitted ellipse")
    right.axvline(0, color="0.5", ls="--", label="true ellipse")
    left.set(xlabel="off the line, along x̄ [mm]", ylabel="z̄ [mm]", title="the middles of the chords")
    right.set(xlabel="off the true ellipse, along x̄ [mm]", title="the tips, and the ellipse fitted to all of them")
    left.invert_yaxis()
    for axes in (left, right):
        axes.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2)


def elliptic_points(left, right, drawn: Drawn) -> None:
    """Figs 6 and 7: the chords in the sensor frame, and in the frame along them with the five points."""
    back = drawn.rotated  # rows x̄, z̄ in the sensor frame
    left.plot(*(drawn.ellipse() @ back).T, color=figures.SKY, lw=2)
    right.plot(*drawn.ellipse().T, color=figures.SKY, lw=2)
    for tips in drawn.tips:
        left.plot(*tips.T, color="black", lw=1)
        right.plot(*(tips @ back.T).T, color="black", lw=1)
    corner, length = (drawn.data.e[2] @ back), 0.75 * drawn.radius
    for axis, name, colour in ((np.array([1, 0]), "x", "0.4"), (back[0], "x̄", figures.RED)):
        arrow(left, corner, corner + length * axis, colour, 2)
        note(left, name, corner + length * axis, (8, 8 if name == "x" else -8), colour)
    theta = np.degrees(np.arctan2(back[0, 1], back[0, 0]))
    note(left, f"θ = {theta:.0f}°", corner + length * (back[0] + [1, 0]) / 2, (16, 0), figures.RED)
    right.plot(*drawn.data.e[:2].T, color=figures.RED, ls="--", lw=1)
    for name, at, offset in zip(NAMES, drawn.data.e, beside(drawn.data.e[:, 1]), strict=True):
        right.plot(*at, "o", color=figures.RED)
        note(right, f"e{name}", at, offset, figures.RED)
    left.set(xlabel="x [mm]", ylabel="z [mm]", title=r"in the sensor frame $\bar\Gamma$")
    right.set(xlabel="x̄ [mm]", ylabel="z̄ [mm]", title=r"turned along the chords, $\bar\Gamma_r$")
    for axes in (left, right):
        axes.set(aspect="equal", anchor="N")
        axes.invert_yaxis()
        axes.margins(0.12)


def points_projected(left, right, drawn: Drawn) -> None:
    """Fig. 11: the diameter q1 q2 in the disk, and its points carried onto the first scan plane."""
    angle = np.linspace(0, 2 * np.pi, 200)
    left.plot(drawn.radius * np.cos(angle), drawn.radius * np.sin(angle), color=figures.SKY, lw=2)
    v = np.linspace(*drawn.at[3:], len(drawn.tips))
    half = drawn.radius * np.sqrt(1 - v**2)
    left.hlines(drawn.radius * v, -half, half, color="black", lw=1)
    left.plot([0, 0], [-drawn.radius, drawn.radius], color="black", ls="--", lw=1)
    for name, at, offset in zip(NAMES, drawn.at, beside(drawn.at), strict=True):
        left.plot(0, drawn.radius * at, "o", color="black")
        note(left, f"q{name}", (0, drawn.radius * at), offset)
    left.margins(0.12)
    left.set(xlabel="along the chords [mm]", ylabel="across them [mm]", aspect="equal", anchor="N", title="in the disk")
    left.invert_yaxis()
    side_view(right, drawn, "carried along M onto the first plane")
    right.axvline(drawn.q[3, 0], color=figures.BLUE, lw=1.5)
    for name, at, onto in zip(NAMES, drawn.q, drawn.projected(drawn.q), strict=True):
        arrow(right, at, onto, "0.4")
        right.plot(*at, "o", color="black", ms=5)
        right.plot(*onto, "o", color=figures.RED, ms=5)
        side = np.sign(at[0] - onto[0])
        if name != "4":  # q4 and e4 are one point
            note(right, f"q{name}", at, (13 * side, 0))
            note(right, f"e{name}", onto, (-14 * side, 0), figures.RED)
    note(right, "q4 = e4", drawn.q[3], (-26 * np.sign(drawn.q[1, 0]), -8), figures.RED)
    right.margins(0.25, 0.15)


def flange_positions(axes, drawn: Drawn) -> None:
    """Fig. 12: five flange positions on one line, and the scan plane at each."""
    side_view(axes, drawn, "")
    T = np.array([0, -1.9 * drawn.radius]) + drawn.q[:, :1] * drawn.way
    r = drawn.q[1] + (drawn.q[:, :1] - drawn.q[1, 0]) * drawn.way
    axes.plot(*T[:2].T, color=figures.RED, lw=1.5)
    axes.plot(*r[:2].T, color=figures.GREEN, lw=1.5)
    for name, eta, top, q, on_r in zip(NAMES, drawn.data.eta, T, drawn.q, r, strict=True):
        axes.plot([q[0], q[0]], [top[1], max(q[1], on_r[1])], color=figures.BLUE, lw=0.8, zorder=0)
        axes.plot(*top, "s", color=figures.RED, ms=6)
        axes.plot(*q, "o", color="black", ms=5)
        axes.plot(*on_r, "o", color=figures.GREEN, ms=5)
        note(
            axes,
            f"T{name}\nη = {abs(eta) * np.sign(round(eta, 2)):.2f}",
            top,
            (0, -22 if name in "45" else 22),
            figures.RED,
        )
        if name != "2":
            note(axes, f"q{name}", q, (14, 9))
            note(axes, f"r{name}", on_r, (14, -9), figures.GREEN)
    note(axes, "q2 = r2", drawn.q[1], (30 * np.sign(drawn.q[1, 0]), 0))
    axes.margins(0.1, 0.16)
    axes.set_aspect("auto")
    axes.set_ylabel(f"{axes.get_ylabel()}; T drawn nearer than it is")


def tangent_positions(axes, drawn: Drawn) -> None:
    """Fig. 13: the angle α, and D as the third side of a triangle."""
    side_view(axes, drawn, f"α = {np.degrees(drawn.data.alpha):.0f}°, s = {drawn.scans.s[0]:+.0f}")
    q1, q2 = drawn.q[:2]
    r1 = q2 - (q2 - q1)[0] * drawn.way
    for at in (q1, q2):
        axes.axvline(at[0], color=figures.BLUE, lw=1)
    arrow(axes, r1, q2, figures.RED, 2.5)
    arc, reach = np.linspace(0, drawn.data.alpha, 40), 0.45 * drawn.radius
    axes.plot(q1[0] + drawn.scans.s[0] * reach * np.sin(arc), q1[1] + reach * np.cos(arc), color=figures.GREEN, lw=2)
    middle = drawn.data.alpha / 2
    at = q1 + 0.7 * drawn.radius * np.array([drawn.scans.s[0] * np.sin(middle), np.cos(middle)])
    side = np.sign(q2[0] - q1[0])
    note(axes, "α", at, (0, 0), figures.GREEN)
    note(axes, "D", (r1 + q2) / 2, (0, -13 if r1[1] > q1[1] else 13), figures.RED)
    for name, point, way in (("q1", q1, -14), ("r1", r1, -14), ("q2", q2, 14)):
        axes.plot(*point, "o", color=figures.RED if name == "r1" else "black")
        note(axes, name, point, (way * side, 0))
    axes.margins(0.2)
