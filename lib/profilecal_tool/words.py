"""Answers in words, as `profilecal calibrate` and `profilecal verify` print them."""

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import t as student

from profilecal.calibration.calibration import Calibration
from profilecal.calibration.check_mount import MountCheck
from profilecal.calibration.leave_out import PARTS, LeftOut
from profilecal.calibration.verify import Verification
from profilecal.geometry.log import DELAY_S
from profilecal.geometry.noise import FALSE_ALARM, ROBOT, Noise
from profilecal.geometry.observability import HAND_PRECISION, name_direction
from profilecal.joint.prior import FINEST_MM, FREEDOM
from profilecal.joint.solution import Solution
from profilecal.scan.tables import some


def calibration_text(calibration: Calibration, to_paste: str = "") -> str:
    """What `profilecal calibrate` prints for people.

    `to_paste`: the pose as a controller takes it.
    """
    lines = [f"status         {calibration.status}"]
    solution = calibration.solution_or_none
    if solution:
        if calibration.is_known:
            lines += pose_lines(solution, calibration.frame, to_paste)
        used = calibration.poses_used
        rejected = calibration.poses_rejected
        names = f": {some(rejected)}" if rejected else ""
        lines.append(
            f"poses          {len(used)} used, {len(rejected)} rejected{names}"
        )
        if solution.delay_s is not None:
            delay = delay_words(1e3 * solution.delay_s, 1e3 * solution.delay_sd_s)
            lines.append(f"delay          {delay}")
    lines += note_lines(calibration)
    if solution and not calibration.misread:
        usual = solution.prior.scales
        lines.append(f"robot errors   {robot_errors(solution.noise, usual)}")
        if solution.noise_source == "given":  # an estimate makes χ²/dof 1
            lines.append(
                f"residuals      {solution.rms_mm:.3g} mm rms, "
                f"χ²/dof {solution.chi2_per_dof:.3g}"
            )
    return "\n".join(lines)


def delay_words(delay_ms: float, sd_ms: float) -> str:
    """The robot's clock less the scanner's, to the first digit in doubt."""
    if sd_ms > 1e3 * DELAY_S / 2:
        return f"open (± {min(sd_ms, 1e3 * DELAY_S):.0f} ms)"
    digits = max(0, -int(np.floor(np.log10(sd_ms))))
    which = "behind" if delay_ms > 0 else "ahead"
    known = f"{delay_ms:.{digits}f} ± {sd_ms:.{digits}f} ms"
    return f"{known} (the scanner's clock is {which})"


def pose_lines(solution: Solution, frame: str, to_paste: str) -> list[str]:
    """The sensor's pose in a frame and its uncertainty, in lines."""
    x, y, z = solution.translation
    rotation = Rotation.from_matrix(solution.rotation)
    W, P, R = rotation.as_euler("xyz", degrees=True)
    return [
        f"translation    {x:.3f}  {y:.3f}  {z:.3f} mm, "
        f"of the sensor's origin in the {frame} frame",
        f"rotation       {W:.4f}  {P:.4f}  {R:.4f}°, "
        f"R = Rz({R:.4f}) Ry({P:.4f}) Rx({W:.4f})",
        *([to_paste] if to_paste else []),
        f"uncertainty    {deviations(solution.covariance)} about the sensor's x, y, z: "
        "one standard deviation near these poses, from noise, robot errors, tolerances",
    ]


def note_lines(calibration: Calibration) -> list[str]:
    """What else there is to say of a calibration, in lines."""
    return [f"note           {message}" for message in calibration.messages]


def deviations(covariance: np.ndarray, delta: np.ndarray | None = None) -> str:
    """δ (6,), mm and rad, in words, or its standard deviations.

    "open" where these say that nothing is known.
    """
    sd = np.sqrt(np.diag(covariance))
    delta = sd if delta is None else delta
    values = np.r_[delta[:3], np.degrees(delta[3:])]
    words = [
        "open" if is_open else brief(value)
        for value, is_open in zip(values, sd >= HAND_PRECISION, strict=True)
    ]
    return f"{'  '.join(words[:3])} mm along and {'  '.join(words[3:])}°"


def brief(value: float) -> str:
    """Two digits, or a whole number."""
    return f"{value:.2g}" if abs(value) < 100 else f"{value:.0f}"


def robot_errors(noise: Noise, usual: Noise) -> str:
    """How large the robot's errors are, at each place where they arise; `usual`: the
    scales that are expected of them.
    """
    # where the law that they are drawn from leaves one in a hundred
    much = student.ppf(1 - FALSE_ALARM / 2, FREEDOM)
    places = ("at each visit", "at each pose", "shared by the poses of an orientation")
    sizes = np.reshape([getattr(noise, name) for name in ROBOT], (3, 2))
    errors = [
        f"{place} {mm:.2g} mm and {deg:.2g}°"
        for place, (mm, deg) in zip(places, sizes, strict=True)
        if max(mm, deg) > FINEST_MM
    ]
    times = noise.group_position_mm / max(usual.group_position_mm, FINEST_MM)
    if times > much:
        errors[-1] += f" ({times:.0f} times the usual: or a second target was seen)"
    if noise.jitter_ms > FINEST_MM:
        errors.append(f"of the times {noise.jitter_ms:.2g} ms")
    return ", ".join(errors) or "none that the residuals show"


def verification_text(verification: Verification, status: str) -> str:
    """What `profilecal verify` prints; `status`: of the pose in question."""
    alone = verification.alone
    (scan,) = alone.scans
    lines = [f"pose           {status}", f"scan alone     {alone.status}"]
    if alone.status != "ok":
        lines[-1] += ", so also looked at near the pose"
        lines += note_lines(alone)

    expected = verification.expected
    apart = verification.apart
    worst = np.argmax(np.abs(apart))
    determined = expected.directions[-len(apart) :]
    direction = name_direction(determined[worst], np.eye(3), "sensor")
    difference = deviations(expected.covariance, verification.delta)
    lines += [
        f"differs by     {difference} about the sensor's x, y, z",
        f"expected       {deviations(expected.covariance)}, one standard deviation",
        f"most apart     {direction}, {brief(abs(apart[worst]))} standard deviations",
        f"chance         {verification.chance:.2g} that right answers differ by more, "
        f"in {len(apart)} of 6 directions; doubted below {FALSE_ALARM:g}",
    ]
    for name, length in verification.lengths.items():
        given = scan.measures[name]
        lines.append(f"{name:<15}{length:.3f} mm by the pose, {given:g} given")
    lines.append(
        f"residuals      {verification.rms_mm:.3g} mm rms from a "
        f"{scan.target.shape}, by the pose"
    )
    if verification.as_expected and verification.is_conclusive:
        verdict = "the stated uncertainties explain what was found"
    elif verification.as_expected:
        verdict = (
            f"no contradiction, but this scan leaves {6 - len(apart)} of 6 directions "
            "open: it does not verify the pose; add poses"
        )
    else:
        verdict = (
            "more is wrong than the stated uncertainties explain: the scanner has "
            "moved, or robot, target or calibration err"
        )
    return "\n".join([*lines, f"verdict        {verdict}"])


def mount_check_text(check: MountCheck, kind: str) -> str:
    """What `profilecal check-mount` prints."""
    lines = [
        f"poses          {some(check.labels)}",
        f"differs by     χ² {check.chi2:.3g}; about {len(check.residuals)} expected, "
        f"doubted above {check.limit:.3g}",
        f"chance         {check.chance:.2g} that it is larger where nothing has moved",
    ]
    if not check.as_expected and check.suspects:
        for frame in ("sensor", "flange"):
            sizes, sds = check.alone_mm_deg(frame)
            k = np.argmax(np.abs(sizes) / sds)
            word, unit = [("along", " mm"), ("about", "°")][k // 3]
            size = f"{sizes[k]:+.2g} ± {sds[k]:.1g}{unit}"
            name = f"{word} the {frame}'s {'xyz'[k % 3]}"
            lines.append(f"as if          moved {size} {name}, and no other way")
    if not check.as_expected:
        for name, move in (("sensor", check.sensor), (kind, check.target)):
            says = f"{move.chance:.2g} that it is larger if the {name} alone has moved"
            if move.chance < 1:  # else any move explains what so few poses saw
                lines.append(f"chance         {says}")
    x, y, z, rx, ry, rz = map(brief, check.seen_mm_deg)
    if check.is_conclusive:
        lines.append(
            f"would show     {x}  {y}  {z} mm along or {rx}  {ry}  {rz}° about "
            "the sensor's x, y, z, 9 times of 10"
        )
    verdicts = {
        (): f"no move of the sensor or the {kind} alone explains it: is it the {kind} "
        "of the calibration, where it stood? If so, look at the robot",
        ("sensor",): "the sensor has moved: calibrate anew",
        ("target",): f"the {kind} has moved, not the sensor",
        ("sensor", "target"): f"the sensor or the {kind} has moved: these poses "
        "cannot tell which; add poses that see it from other sides",
    }
    verdict = verdicts[check.suspects]
    if check.as_expected:
        verdict = "all is where the calibration left it"
    if not check.is_conclusive:
        verdict = (
            "none: only moves of more than 10 mm and 5° would show; calibrate with "
            "more poses"
        )
    return "\n".join([*lines, f"verdict        {verdict}"])


def left_out_sentences(left: LeftOut) -> list[str]:
    """What the other orientations say of each one, in sentences a person can act on."""
    kept = np.flatnonzero(np.isfinite(left.rms_mm))
    sentences = [left_out_summary(left, kept)] if len(kept) else []
    for g in np.flatnonzero(left.doubted):
        sentences.append(
            f"what {poses_named(left.poses[g])} saw does not fit the other "
            f"orientations: its residuals are beyond chance ({left.rms_mm[g]:.2g} mm "
            f"rms, {left.expected_mm[g]:.2g} expected); "
            "measure it again or look for what moved"
        )
    for g in np.flatnonzero(~np.isfinite(left.rms_mm)):
        sentences.append(
            f"without {poses_named(left.poses[g])} the answer is not determined; "
            "add orientations like it"
        )
    return sentences


def left_out_summary(left: LeftOut, kept: np.ndarray) -> str:
    """How well those `kept` are predicted, and how far the sensor moves."""
    rms = np.sqrt(np.mean(left.rms_mm[kept] ** 2))
    expected = np.sqrt(np.mean(left.expected_mm[kept] ** 2))
    shift = np.linalg.norm(left.moved_mm_deg[kept, :3], axis=1)
    turn = np.linalg.norm(left.moved_mm_deg[kept, 3:], axis=1)
    farthest = poses_named(left.poses[kept[np.argmax(shift)]])
    most = poses_named(left.poses[kept[np.argmax(turn)]])
    times = "one" if len(left.poses) <= PARTS else "a hundredth"
    return (
        f"{len(kept)} orientations left out {times} at a time: the others predict them "
        f"to {rms:.2g} mm rms, {expected:.2g} expected; the sensor moves by up to "
        f"{shift.max():.2g} mm (without {farthest}) and turns by up to "
        f"{turn.max():.2g}° (without {most})"
    )


def poses_named(labels: tuple[str, ...]) -> str:
    """Poses in a few words."""
    if len(labels) == 1:
        return f"pose {labels[0]}"
    return f"poses {labels[0]} to {labels[-1].rsplit(': ')[-1]}"
