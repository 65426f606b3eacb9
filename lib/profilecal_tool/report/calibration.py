"""What a calibration says, for the report: every function takes a
`calibrate.Calibration`.
"""

from dataclasses import dataclass, replace
from html import escape

import numpy as np

from profilecal.geometry.noise import FALSE_ALARM, chi2_limit
from profilecal_pages.figures import GREEN, ORANGE, RED
from profilecal_tool.controllers import for_controller, writing_like
from profilecal_tool.words import calibration_text, deviations

VERDICTS = {
    "ok": (
        "The scanner's pose is known to {:.2g} mm and {:.2g}°",
        GREEN,
        "That is one standard deviation in the worst direction, on this robot near these poses.",
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


def words(sentences) -> Html:
    """Sentences as a list."""
    listed = [
        sentence[0].upper() + sentence[1:] + "." * (sentence[-1] not in ".?!")
        for sentence in sentences
    ]
    html = "".join(f"<li>{escape(sentence)}</li>" for sentence in listed)
    return Html(f"<ul>{html}</ul>", "\n".join(f"- {sentence}" for sentence in listed))


def verdict(found) -> Html:
    """The status in words, what to do about it, and what else there is to say."""
    title, colour, text = VERDICTS[found.status]
    if found.status == "ok":
        C = found.solution.covariance
        mm, rad = (
            np.sqrt(np.linalg.eigvalsh(block)[-1]) for block in (C[:3, :3], C[3:, 3:])
        )
        title = title.format(mm, np.degrees(rad))
    notes = words(found.messages) if found.messages else Html("", "")
    html = f'<p style="margin:0"><strong style="font-size:1.15em">{title}.</strong> {text}</p>{notes.html}'
    html = f'<div class="verdict" style="border-left:6px solid {colour};padding:0.6em 1em">{html}</div>'
    return Html(html, f"{title}. {text}\n{notes.plain}".strip())


def answer(found) -> Html:
    """What was scanned, what `profilecal calibrate` prints, without notes, for a robot
    that writes poses like these, and the rest.
    """
    lines = [
        f"scan           {scan.title or scan.kind}: {scan.description}"
        for scan in found.scans
    ]
    s, known = found.solution, found.status != "unobservable"
    maker = writing_like(found.scans[0].convention)
    to_paste = for_controller(maker, s.pose, found.frame) if known else ""
    lines += calibration_text(replace(found, messages=()), to_paste).splitlines()
    if known:
        robot = f"{s.prior.systematic.accuracy_mm:g} mm and {s.prior.systematic.accuracy_deg:g}° over its workspace"
        lines.append(
            f"elsewhere      {deviations(s.covariance_total)}, on a robot accurate to {robot}"
        )
    if s and not found.misread:
        lines.append(
            f"noise          {s.noise_mm:.3g} mm, {s.prior.how}; residuals {s.rms_mm:.3g} mm rms"
        )
    text = "\n".join(lines)
    return Html(f'<pre style="white-space:pre-wrap">{escape(text)}</pre>', text)


def chance_limits(found) -> list[np.ndarray]:
    """For each scan, the residual (P,) over the noise that a good pose exceeds so
    seldom that none of them should.
    """
    total = sum(map(len, found.seen))
    counts = [
        o.target.rows * np.isfinite(o.points[0, :, :, 0]).sum(axis=1)
        for o in found.observed
    ]
    return [np.sqrt(chi2_limit(FALSE_ALARM / total, count) / count) for count in counts]


def rejected_poses(found) -> Html:
    """The poses whose residuals are too large, and how large."""
    said = []
    if found.solution:
        parts = (
            found.labels_by_scan(),
            found.solution.normalised,
            found.solution.rejected,
            chance_limits(found),
        )
        for labels, size, bad, limit in zip(*parts, strict=True):
            for i in np.flatnonzero(bad):
                why = (
                    f"chance explains up to {limit[i]:.1f}"
                    if size[i] > limit[i]
                    else "most of its group is off"
                )
                said.append(f"pose {labels[i]}: {size[i]:.1f} times the noise; {why}")
    return words(said or ["none"])
