"""What a calibration says, for the report.

Every function takes a `profilecal.calibration.calibration.Calibration`.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from itertools import chain

import numpy as np

from profilecal.calibration.calibration import Calibration
from profilecal.geometry.noise import FALSE_ALARM, chi2_limit
from profilecal.geometry.observability import brief
from profilecal_pages.figures import GREEN, ORANGE, RED
from profilecal_tool.controllers import for_controller, writing_like
from profilecal_tool.plan.scan_model import largest_sd
from profilecal_tool.words import answer_lines, error_lines, points_known

VERDICTS = {
    "ok": (
        "The scanner's pose is known to {} mm and {}°",
        GREEN,
        "That is one standard deviation in the worst direction, on this robot near "
        "these poses. A measured point in the middle of what was seen is known to "
        "{} mm, the robot's smooth errors included.",
    ),
    "weak": (
        "Solved, but not well enough to rely on",
        ORANGE,
        "Some direction is known no better than 1 mm or 0.5°, another pose fits as "
        "well, or the residuals show that something is wrong. Why, and what to do:",
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

    def _repr_mimebundle_(self, include: object = None, exclude: object = None) -> dict:
        return {"text/plain": self.plain, "text/html": self.html}


def words(sentences: Iterable[str]) -> Html:
    """Sentences as a list."""
    html = plain = ""
    for sentence in sentences:
        stop = "" if sentence.endswith((".", "?", "!")) else "."
        whole = sentence[0].upper() + sentence[1:] + stop
        html += f"<li>{escape(whole)}</li>"
        plain += f"- {whole}\n"
    return Html(f"<ul>{html}</ul>", plain.rstrip())


def verdict(calibration: Calibration) -> Html:
    """The status in words, what to do about it, and what else there is to say."""
    title, colour, text = VERDICTS[calibration.status]
    if calibration.status == "ok":
        title = title.format(*map(brief, largest_sd(calibration.covariance_mm_deg)))
        text = text.format(brief(points_known(calibration)[1, 1]))
    notes = words(calibration.messages) if calibration.messages else Html("", "")
    html = (
        f'<div class="verdict" style="border-left:6px solid {colour};'
        'padding:0.6em 1em"><p style="margin:0"><strong style="font-size:1.15em">'
        f"{title}.</strong> {text}</p>{notes.html}</div>"
    )
    return Html(html, f"{title}. {text}\n{notes.plain}".strip())


def answer(found: Calibration) -> Html:
    """What was scanned, and what `profilecal calibrate` prints, without notes, with the
    line for a robot that writes poses like these.
    """
    scans = [
        f"scan           {scan.title or scan.kind}: {scan.description}"
        for scan in found.scans
    ]
    to_paste = ""
    if found.is_known:
        maker = writing_like(found.scans[0].convention)
        to_paste = for_controller(maker, found.pose, found.frame)
    lines = [*scans, *answer_lines(found, to_paste), *error_lines(found)]
    text = "\n".join(lines)
    return Html(f'<pre style="white-space:pre-wrap">{escape(text)}</pre>', text)


def of_poses(calibration: Calibration) -> tuple[Sequence[np.ndarray], ...]:
    """Of each scan's poses (P,): residuals over the noise, which poses are rejected,
    and limits that are exceeded so seldom that no good pose should.
    """
    solution = calibration.solution
    count = solution.problem.freedoms
    limits = np.sqrt(chi2_limit(FALSE_ALARM / len(count), count) / count)
    return solution.normalised, solution.rejected, solution.problem.split(limits)


def rejected_poses(calibration: Calibration) -> Html:
    """The poses whose residuals are too large, and how large."""
    sentences = []
    if calibration.solution_or_none:
        labels = chain(*calibration.labels_by_scan())
        parts = map(np.concatenate, of_poses(calibration))
        sentences = [
            f"pose {label}: {size:.1f} times the noise; chance explains {limit:.1f}"
            for label, size, rejected, limit in zip(labels, *parts, strict=True)
            if rejected
        ]
    return words(sentences or ["none"])
