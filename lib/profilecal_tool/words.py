"""Answers in words: lines, each a name and a text, from which all that is printed and
the report are made.
"""

import numpy as np
from numpy import ndarray
from scipy.spatial.transform import Rotation

from profilecal.calibration.answer import DEGREES, Answer
from profilecal.calibration.calibration import Calibration
from profilecal.calibration.check_mount import MountCheck
from profilecal.calibration.points import over_all_seen
from profilecal.calibration.verify import Verification
from profilecal.geometry.log import DELAY_S
from profilecal.geometry.noise import FALSE_ALARM, ROBOT, Noise
from profilecal.geometry.observability import (
    HAND_PRECISION,
    brief,
    name_direction,
    shift_and_turn,
)
from profilecal.joint.prior import FINEST_MM
from profilecal.joint.solution import Solution
from profilecal.scan.tables import listed
from profilecal_tool.checking import Lines

ABOUT = "about the sensor's x, y, z"


def printed(lines: Lines) -> str:
    """Lines as commands print them."""
    return "\n".join(f"{name:<15}{text}" if name else text for name, text in lines)


def deviations(covariance: ndarray, delta: ndarray | None = None) -> str:
    """Standard deviations of a covariance (6, 6), mm and rad, in words; or a difference
    (6,) of that covariance. What is known no better than by hand is open.
    """
    sd = np.sqrt(np.diag(covariance))
    shown = sd if delta is None else delta
    return shift_and_turn(np.where(sd < HAND_PRECISION, shown * DEGREES, np.nan))


def calibration_lines(found: Calibration, to_paste: str = "") -> Lines:
    """What was found, with a line to paste into a controller if there is one."""
    yield "status", found.status
    solution = found.solution_or_none
    if found.is_known:
        yield from pose_lines(found, to_paste)
    if solution:
        used, rejected = found.poses_used, found.poses_rejected
        names = f": {listed(rejected)}" if rejected else ""
        yield "poses", f"{len(used)} used, {len(rejected)} rejected{names}"
        if solution.delay_s is not None:
            sizes = 1e3 * solution.delay_s, 1e3 * solution.delay_sd_s
            yield "delay", delay_words(*sizes)
    if found.is_known:
        sd = points_sd_mm(found)
        yield (
            "points",
            f"known to {brief(sd[1, 1])} mm in the middle of what was seen, "
            f"{brief(sd.max())} at the worst corner "
            "(one sd, three axes together, smooth errors included)",
        )
    if solution and not found.misread:
        yield "robot errors", robot_errors(solution.noise)
        yield "residuals", residuals(solution)
    yield from notes(found)


def pose_lines(found: Calibration, to_paste: str) -> Lines:
    """A pose and its uncertainty."""
    pose, noise = found.pose, found.solution.noise
    x, y, z = pose[:3, 3]
    W, P, R = Rotation.from_matrix(pose[:3, :3]).as_euler("xyz", degrees=True)
    yield (
        "translation",
        f"{x:.3f}  {y:.3f}  {z:.3f} mm, "
        f"of the sensor's origin in the {found.frame} frame",
    )
    yield (
        "rotation",
        f"{W:.4f}  {P:.4f}  {R:.4f}°, R = Rz({R:.4f}) Ry({P:.4f}) Rx({W:.4f})",
    )
    if to_paste:
        yield "", to_paste
    near = deviations(found.solution.covariance)
    yield "uncertainty", f"{near} {ABOUT}: one standard deviation, near these poses"
    smooth = ""
    if noise.accuracy_mm:
        sizes = f"{brief(noise.accuracy_mm)} mm and {brief(noise.accuracy_deg)}°"
        smooth = f", with the robot's smooth errors, taken as {sizes}"
    yield "elsewhere", deviations(found.solution.covariance_total) + smooth


def points_sd_mm(found: Calibration) -> ndarray:
    """How well points are known, (3, 3) mm, from corner to corner of what was seen, in
    three axes together.
    """
    sd = found.point_sd_mm(*over_all_seen(found.solution))
    return np.linalg.norm(sd, axis=-1)


def notes(found: Calibration) -> Lines:
    """What a person should know."""
    return [("note", message) for message in found.messages]


def delay_words(delay_ms: float, sd_ms: float) -> str:
    """A delay, to the first digit of its standard deviation."""
    most_ms = 1e3 * DELAY_S
    if sd_ms > most_ms / 2:
        return f"open (± {min(sd_ms, most_ms):.0f} ms)"
    digits = max(0, -int(np.floor(np.log10(sd_ms))))
    clock = "behind" if delay_ms > 0 else "ahead"
    size = f"{delay_ms:.{digits}f} ± {sd_ms:.{digits}f} ms"
    return f"{size} (the scanner's clock is {clock})"


def robot_errors(noise: Noise) -> str:
    """The robot's errors, beside smooth ones, by where they arise."""
    places = "at each visit", "at each pose", "shared by the poses of an orientation"
    said = []
    for place, *names in zip(places, ROBOT[::2], ROBOT[1::2], strict=True):
        mm, deg = (getattr(noise, name) for name in names)
        if max(mm, deg) > FINEST_MM:
            said.append(f"{place} {mm:.2g} mm and {deg:.2g}°")
    if noise.jitter_ms > FINEST_MM:
        said.append(f"of the times {noise.jitter_ms:.2g} ms")
    others = "no others" if noise.accuracy_mm else "none"
    return ", ".join(said) or f"{others} that residuals show"


def residuals(solution: Solution) -> str:
    """How large they are; χ² says something where the noise is stated."""
    size = f"{solution.rms_mm:.3g} mm rms"
    if solution.noise_source == "given":
        return f"{size}, χ²/dof {solution.chi2_per_dof:.3g}"
    return size


def verification_lines(checked: Verification, answer: Answer) -> Lines:
    """How far another scan's answer, or another answer, is from an answer."""
    other, expected, apart = checked.other, checked.expected, checked.apart
    is_scan = isinstance(other, Calibration)
    yield "pose", answer.status
    if not is_scan:
        yield "other pose", other.status
    elif other.status == "ok":
        yield "scan alone", "ok"
    else:
        rests = "what it leaves open rests on the pose, its guess"
        yield "scan alone", f"{other.status}: {rests}"
        yield from notes(other)
    difference = deviations(expected.covariance, checked.delta)
    yield "differs by", f"{difference} {ABOUT}"
    yield "expected", f"{deviations(expected.covariance)}, one standard deviation"
    worst = np.abs(apart).argmax() - len(apart)
    direction = name_direction(expected.directions[worst], np.eye(3), "sensor")
    size = brief(abs(apart[worst]))
    yield "most apart", f"{direction}, {size} standard deviations"
    yield (
        "chance",
        f"{checked.chance:.2g} that right answers differ by more, "
        f"in {len(apart)} of 6 directions; doubted below {FALSE_ALARM}",
    )
    yield from sizes_by(checked) if is_scan else shared_by(answer, other)
    yield "verdict", verdict_on(checked)


def sizes_by(checked: Verification) -> Lines:
    """What the pose makes of the target in another scan."""
    (scan,) = checked.other.scans
    for name, mm in checked.sizes.items():
        yield name, f"{mm:.3f} mm by the pose, {scan.sizes[name]:g} given"
    rms = f"{checked.rms_mm:.3g} mm rms"
    yield "residuals", f"{rms} from a {scan.target.shape}, by the pose"


def shared_by(one: Answer, other: Answer) -> Lines:
    """What the difference of two answers does not show."""
    both = " or ".join(sorted(kinds(one) & kinds(other)))
    target = f", of the {both} if it is one" if both else ""
    errors = f"errors of the robot at all poses alike{target}"
    yield "shared", f"{errors}: no difference shows them"


def kinds(answer: Answer) -> set[str]:
    """Of the targets that an answer is from, if it says so."""
    return {kind for kind, *_ in answer.joint.targets} if answer.joint else set()


def verdict_on(checked: Verification) -> str:
    """Of a comparison."""
    if not checked.as_expected:
        return (
            "more is wrong than the stated uncertainties explain: "
            "the scanner has moved, or robot, target or calibration err"
        )
    if checked.is_misread:
        return (
            "no contradiction, but this scan contradicts itself: it does not verify "
            "the pose; do what the notes say"
        )
    if not checked.is_conclusive:
        return (
            f"no contradiction, but this scan leaves {6 - len(checked.apart)} of 6 "
            "directions open: it does not verify the pose; add poses"
        )
    return "the stated uncertainties explain what was found"


MOVED = {  # by what may have moved
    (): "no move of the sensor or the {0} alone explains it: is it the {0} of the "
    "calibration, where it stood? If so, look at the robot",
    ("sensor",): "the sensor has moved: calibrate anew",
    ("target",): "the {0} has moved, not the sensor",
    ("sensor", "target"): "the sensor or the {0} has moved: these poses cannot tell "
    "which; add poses that see it from other sides",
}


def mount_check_lines(check: MountCheck, kind: str) -> Lines:
    """Whether anything has moved since a calibration with a target of a kind."""
    yield "poses", listed(check.labels)
    yield (
        "differs by",
        f"χ² {check.chi2:.3g}; about {check.count} expected, "
        f"doubted above {check.limit:.3g}",
    )
    yield "chance", f"{check.chance:.2g} that it is larger where nothing has moved"
    if not check.as_expected:
        yield from moves(check, kind)
    if check.is_conclusive:
        sizes = shift_and_turn(check.seen_mm_deg, "or")
        yield "would show", f"{sizes} {ABOUT}, 9 times of 10"
    yield "verdict", mount_verdict(check, kind)


def moves(check: MountCheck, kind: str) -> Lines:
    """Which moves would explain what was seen, and how well."""
    if "sensor" in check.suspects:
        (sizes, sds), k = check.alone_mm_deg, check.axis
        way = " mm along" if k < 3 else "° about"
        size = f"{sizes[k]:+.2g} ± {sds[k]:.1g}{way}"
        axis = f"the sensor's {'xyz'[k % 3]}"
        yield "as if", f"moved {size} {axis}, and no other way"
    for what, chance in zip(("sensor", kind), check.chances.values(), strict=True):
        if chance < 1:  # else any move explains what so few poses saw
            moved = f"the {what} alone has moved"
            yield "chance", f"{chance:.2g} that it is larger if {moved}"


def mount_verdict(check: MountCheck, kind: str) -> str:
    """Of what may have moved."""
    if not check.is_conclusive:
        return (
            "none: only moves of more than 10 mm and 5° would show; "
            "calibrate with more poses"
        )
    if not check.as_expected:
        return MOVED[check.suspects].format(kind)
    tested = ""
    if check.tested < 6:
        tested = f", in the {check.tested} of 6 directions that these poses test"
    return f"all is where the calibration left it{tested}"
