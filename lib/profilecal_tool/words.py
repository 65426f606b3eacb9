"""Answers in words, as commands print them and the report shows them: lines that begin
with a name.
"""

import numpy as np
from numpy import ndarray
from scipy.spatial.transform import Rotation

from profilecal.calibration.answer import Answer
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
from profilecal.scan.scan import Scan
from profilecal.scan.tables import listed


def calibration_text(found: Calibration, to_paste: str = "") -> str:
    """What `profilecal calibrate` prints for people.

    `to_paste`: the pose as a controller takes it.
    """
    lines = answer_lines(found, to_paste) + note_lines(found) + error_lines(found)
    return "\n".join(lines)


def answer_lines(found: Calibration, to_paste: str = "") -> list[str]:
    """The status of a calibration, the sensor's pose, and what that rests on."""
    lines = [f"status         {found.status}"]
    solution = found.solution_or_none
    if solution is None:
        return lines
    if found.is_known:
        lines += pose_lines(solution, found.frame, to_paste)
    used, rejected = len(found.poses_used), found.poses_rejected
    names = f": {listed(rejected)}" if rejected else ""
    lines.append(f"poses          {used} used, {len(rejected)} rejected{names}")
    if solution.delay_s is not None:
        delay = delay_words(1e3 * solution.delay_s, 1e3 * solution.delay_sd_s)
        lines.append(f"delay          {delay}")
    if found.is_known:
        sd = points_known(found)
        lines.append(
            f"points         known to {brief(sd[1, 1])} mm in the middle of what was "
            f"seen, {brief(sd.max())} at the worst corner (one sd, three axes "
            "together, smooth errors included)"
        )
    return lines


def points_known(found: Calibration) -> ndarray:
    """How well points all over what was seen are known, in three axes together, mm."""
    places = over_all_seen(found.solution)
    return np.linalg.norm(found.point_sd_mm(*places), axis=2)


def pose_lines(solution: Solution, frame: str, to_paste: str) -> list[str]:
    """The sensor's pose in a frame and its uncertainty."""
    x, y, z = solution.translation
    W, P, R = Rotation.from_matrix(solution.rotation).as_euler("xyz", degrees=True)
    errors = solution.noise
    sizes = f"{brief(errors.accuracy_mm)} mm and {brief(errors.accuracy_deg)}°"
    smooth = f", with the robot's smooth errors, taken as {sizes}"
    lines = [
        f"translation    {x:.3f}  {y:.3f}  {z:.3f} mm, "
        f"of the sensor's origin in the {frame} frame",
        f"rotation       {W:.4f}  {P:.4f}  {R:.4f}°, "
        f"R = Rz({R:.4f}) Ry({P:.4f}) Rx({W:.4f})",
        to_paste,
        f"uncertainty    {deviations(solution.covariance)} about the sensor's x, y, z: "
        "one standard deviation, near these poses",
        f"elsewhere      {deviations(solution.covariance_total)}"
        + smooth * bool(errors.accuracy_mm),
    ]
    return [line for line in lines if line]


def note_lines(found: Calibration) -> list[str]:
    """What else there is to say of a calibration."""
    return [f"note           {message}" for message in found.messages]


def error_lines(found: Calibration) -> list[str]:
    """The errors of the robot that a calibration found, and its residuals."""
    solution = found.solution_or_none
    if solution is None or found.misread:
        return []
    errors = robot_errors(solution.noise)
    # an estimate of the noise makes χ²/dof 1
    chi2 = f", χ²/dof {solution.chi2_per_dof:.3g}"
    chi2 *= solution.noise_source == "given"
    return [
        f"robot errors   {errors}",
        f"residuals      {solution.rms_mm:.3g} mm rms{chi2}",
    ]


def delay_words(delay_ms: float, sd_ms: float) -> str:
    """The robot's clock less the scanner's, to the first digit in doubt."""
    if sd_ms > 1e3 * DELAY_S / 2:
        return f"open (± {min(sd_ms, 1e3 * DELAY_S):.0f} ms)"
    digits = max(0, -int(np.floor(np.log10(sd_ms))))
    which = "behind" if delay_ms > 0 else "ahead"
    known = f"{delay_ms:.{digits}f} ± {sd_ms:.{digits}f} ms"
    return f"{known} (the scanner's clock is {which})"


def deviations(covariance: ndarray, delta: ndarray | None = None) -> str:
    """δ (6,), mm and rad, in words, or its standard deviations.

    "open" where these say that nothing is known.
    """
    sd = np.sqrt(np.diag(covariance))
    values = sd if delta is None else delta
    known = np.where(sd < HAND_PRECISION, values, np.nan)
    return shift_and_turn(np.r_[known[:3], np.degrees(known[3:])])


def robot_errors(noise: Noise) -> str:
    """How large the robot's errors are, at each place where they arise."""
    places = ("at each visit", "at each pose", "shared by the poses of an orientation")
    sizes = np.reshape([getattr(noise, name) for name in ROBOT], (3, 2))
    errors = [
        f"{place} {mm:.2g} mm and {deg:.2g}°"
        for place, (mm, deg) in zip(places, sizes, strict=True)
        if max(mm, deg) > FINEST_MM
    ]
    if noise.jitter_ms > FINEST_MM:
        errors.append(f"of the times {noise.jitter_ms:.2g} ms")
    others = "no others" if noise.accuracy_mm else "none"
    return ", ".join(errors) or f"{others} that residuals show"


def verification_text(checked: Verification, found: Answer) -> str:
    """What `profilecal verify` prints of the answer in question."""
    other, expected, apart = checked.other, checked.expected, checked.apart
    worst = np.argmax(np.abs(apart))
    determined = expected.directions[-len(apart) :]
    direction = name_direction(determined[worst], np.eye(3), "sensor")
    difference = deviations(expected.covariance, checked.delta)
    verdict = (
        "more is wrong than the stated uncertainties explain: the scanner has "
        "moved, or robot, target or calibration err"
    )
    if checked.as_expected:
        verdict = "the stated uncertainties explain what was found"
        if not checked.is_conclusive:
            verdict = (
                f"no contradiction, but this scan leaves {6 - len(apart)} of 6 "
                "directions open: it does not verify the pose; add poses"
            )
    lines = [
        f"pose           {found.status}",
        *other_lines(other),
        f"differs by     {difference} about the sensor's x, y, z",
        f"expected       {deviations(expected.covariance)}, one standard deviation",
        f"most apart     {direction}, {brief(abs(apart[worst]))} standard deviations",
        f"chance         {checked.chance:.2g} that right answers differ by more, "
        f"in {len(apart)} of 6 directions; doubted below {FALSE_ALARM:g}",
    ]
    if isinstance(other, Answer):
        lines.append(f"shared         {shared_by(found, other)}")
    else:
        lines += target_lines(checked, *other.scans)
    return "\n".join([*lines, f"verdict        {verdict}"])


def other_lines(other: Calibration | Answer) -> list[str]:
    """The status of what an answer is compared with."""
    if isinstance(other, Answer):
        return [f"other pose     {other.status}"]
    if other.status == "ok":
        return ["scan alone     ok"]
    line = f"scan alone     {other.status}: what it leaves open rests on the pose"
    return [line, *note_lines(other)]


def target_lines(checked: Verification, scan: Scan) -> list[str]:
    """What a scan's target is by the pose in question."""
    lines = [
        f"{name:<15}{length:.3f} mm by the pose, {scan.measures[name]:g} given"
        for name, length in checked.lengths.items()
    ]
    residuals = f"{checked.rms_mm:.3g} mm rms from a {scan.target.shape}, by the pose"
    return [*lines, f"residuals      {residuals}"]


def shared_by(found: Answer, other: Answer) -> str:
    """What two answers have in common that their difference does not show."""
    one, two = (
        {kind for kind, *_ in answer.joint.targets} if answer.joint else set()
        for answer in (found, other)
    )
    kinds = " or ".join(sorted(one & two))
    target = f", of the {kinds} if it is one" * bool(kinds)
    return f"errors of the robot at all poses alike{target}: no difference shows them"


def mount_check_text(check: MountCheck, kind: str) -> str:
    """What `profilecal check-mount` prints."""
    lines = [
        f"poses          {listed(check.labels)}",
        f"differs by     χ² {check.chi2:.3g}; about {check.count} expected, "
        f"doubted above {check.limit:.3g}",
        f"chance         {check.chance:.2g} that it is larger where nothing has moved",
    ]
    if not check.as_expected:
        lines += move_lines(check, kind)
    if check.is_conclusive:
        would_show = shift_and_turn(check.seen_mm_deg, "or")
        lines.append(
            f"would show     {would_show} about the sensor's x, y, z, 9 times of 10"
        )
    return "\n".join([*lines, f"verdict        {mount_verdict(check, kind)}"])


def move_lines(check: MountCheck, kind: str) -> list[str]:
    """What has moved, by how much, and how well that explains what was seen."""
    lines = []
    if check.suspects:
        sizes, sds = check.alone_mm_deg
        k = np.argmax(np.abs(sizes) / sds)
        word, unit = [("along", " mm"), ("about", "°")][k // 3]
        size = f"{sizes[k]:+.2g} ± {sds[k]:.1g}{unit}"
        axis = f"{word} the sensor's {'xyz'[k % 3]}"
        lines.append(f"as if          moved {size} {axis}, and no other way")
    for name, chance in zip(("sensor", kind), check.chances.values(), strict=True):
        says = f"{chance:.2g} that it is larger if the {name} alone has moved"
        if chance < 1:  # else any move explains what so few poses saw
            lines.append(f"chance         {says}")
    return lines


def mount_verdict(check: MountCheck, kind: str) -> str:
    """What to believe of the mount, and what to do."""
    if not check.is_conclusive:
        return (
            "none: only moves of more than 10 mm and 5° would show; calibrate with "
            "more poses"
        )
    if check.as_expected:
        part = f", in the {check.tested} of 6 directions that these poses test"
        return f"all is where the calibration left it{part * (check.tested < 6)}"
    verdicts = {
        (): f"no move of the sensor or the {kind} alone explains it: is it the {kind} "
        "of the calibration, where it stood? If so, look at the robot",
        ("sensor",): "the sensor has moved: calibrate anew",
        ("target",): f"the {kind} has moved, not the sensor",
        ("sensor", "target"): f"the sensor or the {kind} has moved: these poses "
        "cannot tell which; add poses that see it from other sides",
    }
    return verdicts[check.suspects]
