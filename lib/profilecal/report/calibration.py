"""What a calibration says, in words and tables: every function takes a `calibrate.Calibration`."""

from dataclasses import dataclass
from html import escape

import numpy as np
import pandas as pd
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from profilecal.calibrate.summary import deviations, robot_errors
from profilecal.geometry.noise import FALSE_ALARM, chi2_limit
from profilecal.joint.observability import name_direction, size_direction
from profilecal.report.figures import GREEN, ORANGE, RED
from profilecal.scan.conventions import VENDORS, Convention, for_controller, from_rotations, named
from profilecal.targets.target import find_features

VERDICTS = {
    "ok": (
        "The scanner's pose is determined",
        GREEN,
        "The standard deviation of every direction is below 1 mm and 0.5°, on this robot near these poses.",
    ),
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


def paragraphs(*lines: str) -> Html:
    """Lines of text, each a paragraph."""
    return Html("".join(f"<p>{line}</p>" for line in lines), "\n".join(lines))


def html_table(frame: pd.DataFrame) -> Html:
    """A table without its index that scrolls sideways where the screen is narrow."""
    return Html(f'<div class="scroll">{frame.to_html(index=False, border=0)}</div>', frame.to_string(index=False))


def words(sentences) -> Html:
    """Sentences as a list."""
    listed = [sentence[0].upper() + sentence[1:] + "." * (sentence[-1] not in ".?!") for sentence in sentences]
    html = "".join(f"<li>{escape(sentence)}</li>" for sentence in listed)
    return Html(f"<ul>{html}</ul>", "\n".join(f"- {sentence}" for sentence in listed))


def verdict(found) -> Html:
    """The status in words, what to do about it, and what else there is to say."""
    title, colour, text = VERDICTS[found.status]
    notes = words(found.messages)
    html = f'<p style="margin:0"><strong style="font-size:1.15em">{title}.</strong> {text}</p>'
    html += notes.html if found.messages else ""
    html = f'<div class="verdict" style="border-left:6px solid {colour};padding:0.6em 1em">{html}</div>'
    return Html(html, "\n".join(filter(None, [f"{title}. {text}", notes.plain])))


def convention_of(found) -> Convention:
    """The notation of the robot that the poses come from; FANUC's angles where that is a matrix."""
    name = found.scans[0].convention
    return named("FANUC angles" if name == "matrix" else name)


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


def pose_table(found) -> Html:
    """The sensor's pose in the notation of the robot that the poses come from, each number with its uncertainty."""
    if found.status == "unobservable":
        return paragraphs("No pose to state.")
    convention = convention_of(found)
    value, sd = pose_numbers(found.solution, convention)
    names = [c.upper() if convention.sequence and len(c) == 1 else c for c in convention.columns]
    units = ["mm"] * 3 + [convention.unit] * len(names)
    places = {"mm": 3, "deg": 4, "rad": 6, "1": 6}
    rows = {
        "": ["X", "Y", "Z", *names],
        "value": [f"{v:.{places[u]}f}" for v, u in zip(value, units, strict=True)],
        "sd near these poses": [f"{v:.2g}" for v in sd],
        "95 %": [f"±\u00a0{1.96 * v:.2g}" for v in sd],
        "unit": units,
    }
    return html_table(pd.DataFrame(rows))


def pose_words(found) -> Html:
    """How the numbers of `pose_table` are meant, and what they mean for a measured point."""
    if found.status == "unobservable":
        return paragraphs()
    s, meaning = found.solution, convention_of(found).meaning
    seen = np.concatenate([np.asarray(o.points).reshape(-1, 2) for o in found.observed])
    x, z = np.nanmean(seen, axis=0).round() + 0.0  # not -0
    J = np.column_stack([np.eye(3), np.cross(np.eye(3), [x, 0, z]).T])  # δ moves a point p by ρ + φ × p
    placed = np.sqrt(np.trace(J @ s.covariance @ J.T))
    return paragraphs(
        f"Position of the sensor's origin and orientation of its axes in the {found.frame} frame; {meaning}.",
        f"Standard deviations along and about the sensor's own x, y, z: {deviations(s.covariance)} on this robot near "
        f"these poses; {deviations(s.covariance_total)} elsewhere, with the robot's accuracy over its workspace.",
        f"A point in the middle of the scans (x = {x:.0f}, z = {z:.0f} mm) is placed with an error of {placed:.2g} mm "
        "rms by this calibration, near these poses; the robot's and the scanner's own errors come on top.",
    )


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
        rows += [
            ("Method", "joint maximum likelihood"),
            ("Poses", f"{len(found.labels(rejected=False))} used, {len(found.labels(rejected=True))} rejected"),
            ("Noise", f"{s.noise_mm:.3g} mm, {s.level.how}"),
            *(("Robot errors", line) for line in robot_errors(s.level.levels)),
            ("Residuals", f"{s.rms_mm:.3g} mm rms; χ²/dof = {s.chi2_per_dof:.3g} (1: as the noise explains)"),
        ]
    return html_table(pd.DataFrame(rows, columns=["", " "]))


def chance_limits(found) -> list[np.ndarray]:
    """For each scan, the residual (P,) over the noise that a good pose exceeds so seldom that none of them should."""
    total = sum(map(len, found.seen))
    counts = [o.target.rows * np.isfinite(o.points[0, :, :, 0]).sum(axis=1) for o in found.observed]
    return [np.sqrt(chi2_limit(FALSE_ALARM / total, count) / count) for count in counts]


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
        why = {i: feature.reason for i, feature in enumerate(features_of(scan)) if feature.reason}
        rows += [(scan.title, scan.labels[i], why.get(i, "nothing measured")) for i in missed]
    if not rows:
        return paragraphs("None: every pose counts.")
    frame = pd.DataFrame(rows, columns=["scan", "pose", "why"])
    return html_table(frame if len(found.scans) > 1 else frame.drop(columns="scan"))


def features_of(scan) -> list:
    """What is found in each profile of a scan; nothing where the scan holds no raw profiles."""
    return find_features(scan.target, scan.values, scan.sizes) if scan.measured == "profiles" else []


def profile_words(found) -> Html:
    """The key to `plot_profiles`, or what was there instead of profiles."""
    raw = [scan for scan in found.scans if scan.measured == "profiles"]
    if raw:
        curves = {f"the points taken for the {scan.kind}" for scan in raw if not scan.target.points}
        marked = {"the points that the feature rests on" for scan in raw if scan.target.points}
        text = "Each profile in the scanner's x and z, z downwards, all at one scale, around the feature. Blue: "
        text += " or ".join(sorted(curves | marked)) + ("; red circle: the feature found." if marked else ".")
    else:
        kinds = " and ".join(sorted({scan.measured for scan in found.scans}))
        text = f"This scan holds {kinds} instead of raw profiles; the features were found before it was written."
    return paragraphs(text)


def field_of_view(scans) -> np.ndarray | None:
    """The corners (k, 2) of the area in which raw profiles have points, x and z in mm; None without raw profiles."""
    raw = [values for scan in scans if scan.measured == "profiles" for values in scan.values]
    points = np.concatenate([*raw, np.zeros((0, 2))])
    points = points[np.isfinite(points).all(axis=1)]
    return points[ConvexHull(points, qhull_options="QJ").vertices] if len(points) > 2 else None


def view_words(found) -> Html:
    """How much of the field of view the features cover."""
    seen = np.concatenate([np.asarray(o.points).reshape(-1, 2) for o in found.observed])
    (x, z), (x_end, z_end) = np.nanmin(seen, axis=0), np.nanmax(seen, axis=0)
    text = f"The features cover x from {x:.0f} to {x_end:.0f} mm and z from {z:.0f} to {z_end:.0f} mm"
    field = field_of_view(found.scans)
    if field is not None:
        (x, z), (x_end, z_end) = field.min(axis=0), field.max(axis=0)
        text += f"; the profiles reach x from {x:.0f} to {x_end:.0f} mm and z from {z:.0f} to {z_end:.0f} mm"
    return paragraphs(text + ".")


def directions_table(found) -> Html:
    """The six directions of the sensor's pose in words, worst first."""
    if not found.solution:
        return paragraphs("There are fewer measurements than unknowns.")
    s = found.solution.observability
    words = [name_direction(d, found.solution.rotation, found.frame) for d in s.directions]
    size = [size_direction(sd, d) if sd < 10 else "unknown" for sd, d in zip(s.sd, s.directions, strict=True)]
    frame = pd.DataFrame({" ": range(1, 7), "direction of the sensor's pose": words, "standard deviation": size})
    return html_table(frame)


def export_block(found) -> Html:
    """The sensor's pose as each controller takes it."""
    if found.status == "unobservable":
        return paragraphs("Nothing to export.")
    lines = {vendor: for_controller(vendor, found.solution.T_flange_sensor, found.frame) for vendor in VENDORS}
    html = "".join(f"<h4>{VENDORS[vendor]}</h4><pre>{escape(line)}</pre>" for vendor, line in lines.items())
    return Html(html, "\n".join(f"{VENDORS[vendor]}\n{line}\n" for vendor, line in lines.items()))
