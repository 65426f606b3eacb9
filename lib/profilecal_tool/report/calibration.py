"""What the report says of a calibration."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from numpy import ndarray

from profilecal.calibration.calibration import Calibration
from profilecal.geometry.noise import FALSE_ALARM, chi2_limit
from profilecal.geometry.observability import brief
from profilecal_pages.figures import GREEN, ORANGE, RED
from profilecal_tool.controllers import for_controller, writing_like
from profilecal_tool.plan.scan_model import largest_sd
from profilecal_tool.words import calibration_lines, points_sd_mm, printed

VERDICTS = {  # by status: a title, its colour, what it means
    "ok": (
        "The scanner's pose is known to {mm} mm and {deg}°",
        GREEN,
        "That is one standard deviation in the worst direction, on this robot near "
        "these poses. A measured point in the middle of what was seen is known to "
        "{point} mm, the robot's smooth errors included.",
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
class Shown:
    """What a notebook shows: its text, and the same for a page."""

    plain: str
    html: str

    def _repr_mimebundle_(self, include: object = None, exclude: object = None) -> dict:
        return {"text/plain": self.plain, "text/html": self.html}


def words(sentences: Iterable[str]) -> Shown:
    """A list of sentences."""
    whole = [one[0].upper() + one[1:] for one in sentences]
    whole = [one if one.endswith((".", "?", "!")) else f"{one}." for one in whole]
    items = "".join(f"<li>{escape(one, quote=False)}</li>" for one in whole)
    return Shown("\n".join(f"- {one}" for one in whole), f"<ul>{items}</ul>")


def verdict(found: Calibration) -> Shown:
    """Whether there is an answer to rely on, and what to do."""
    title, colour, text = VERDICTS[found.status]
    if found.is_known:
        mm, deg = map(brief, largest_sd(found.covariance_mm_deg))
        title = title.format(mm=mm, deg=deg)
        text = text.format(point=brief(points_sd_mm(found)[1, 1]))
    notes = words(found.messages)
    box = f"border-left:6px solid {colour};padding:0.6em 1em"
    strong = f'<strong style="font-size:1.15em">{title}.</strong>'
    return Shown(
        f"{title}. {text}\n{notes.plain}",
        f'<div class="verdict" style="{box}"><p style="margin:0">{strong} {text}</p>'
        f"{notes.html}</div>",
    )


def answer(found: Calibration) -> Shown:
    """The scans, and what the command prints of them, but for notes."""
    scans = [
        ("scan", f"{scan.title or scan.kind}: {scan.description}")
        for scan in found.scans
    ]
    to_paste = ""
    if found.is_known:
        vendor = writing_like(found.scans[0].convention)
        to_paste = for_controller(vendor, found.pose, found.frame)
    lines = [line for line in calibration_lines(found, to_paste) if line[0] != "note"]
    text = printed(scans + lines)
    html = f'<pre style="white-space:pre-wrap">{escape(text)}</pre>'
    return Shown(text, html)


def of_poses(found: Calibration) -> tuple[Sequence[ndarray], ...]:
    """Of each scan's poses (P,): residuals over the noise, which poses are rejected,
    and limits that are exceeded so seldom that no good pose should.
    """
    solution = found.solution
    count = solution.problem.counts_or_1
    limits = np.sqrt(chi2_limit(FALSE_ALARM / len(count), count) / count)
    return solution.normalised, solution.rejected, solution.problem.split(limits)


def rejected_poses(found: Calibration) -> Shown:
    """The poses whose residuals are too large, and how large."""
    sentences = []
    if found.solution_or_none:
        parts = map(np.concatenate, [found.labels_by_scan(), *of_poses(found)])
        sentences = [
            f"pose {label}: {size:.1f} times the noise; chance explains {limit:.1f}"
            for label, size, is_bad, limit in zip(*parts, strict=True)
            if is_bad
        ]
    return words(sentences or ["none"])
