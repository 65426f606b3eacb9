"""Answers in words, as `profilecal calibrate` and `profilecal verify` print them."""

import numpy as np

from profilecal.calibration.calibration import Calibration
from profilecal.calibration.verify import Verification
from profilecal.geometry.noise import FALSE_ALARM, ROBOT, Noise
from profilecal.geometry.observability import HAND_PRECISION, name_direction
from profilecal.geometry.poses import xyz_angles_from_rotation
from profilecal.joint.prior import FINEST_MM


def calibration_text(found: Calibration, to_paste: str = "") -> str:
    """What `profilecal calibrate` prints for people. `to_paste`: the pose as a
    controller takes it.
    """
    s, lines = found.solution, [f"status         {found.status}"]
    if found.status != "unobservable":
        W, P, R = np.degrees(xyz_angles_from_rotation(s.rotation))
        W = (W + 180) % 360 - 180
        tx, ty, tz = s.translation
        lines += [
            f"translation    {tx:.3f}  {ty:.3f}  {tz:.3f} mm, of the sensor's origin in the {found.frame} frame",
            f"rotation       {W:.4f}  {P:.4f}  {R:.4f}°, R = Rz({R:.4f}) Ry({P:.4f}) Rx({W:.4f})",
            *filter(None, [to_paste]),
            f"uncertainty    {deviations(s.covariance)} about the sensor's x, y, z: one standard deviation near these "
            "poses, from noise, robot errors, tolerances",
        ]
    if s:
        used, rejected = found.labels(rejected=False), found.labels(rejected=True)
        which = f": {', '.join(rejected)}" if rejected else ""
        lines.append(
            f"poses          {len(used)} used, {len(rejected)} rejected{which}"
        )
    lines += [f"note           {message}" for message in found.messages]
    if s and not found.misread:
        lines.append(f"robot errors   {robot_errors(s.noise)}")
        if s.noise_source == "given":  # an estimate makes it 1
            lines.append(
                f"residuals      {s.rms_mm:.3g} mm rms, χ²/dof {s.chi2_per_dof:.3g}"
            )
    return "\n".join(lines)


def deviations(covariance, delta=None) -> str:
    """δ (6,), mm and rad, in words, or its standard deviations; "open" where these say
    that nothing is known.
    """
    sd = np.sqrt(np.diag(covariance))
    delta = sd if delta is None else delta
    values = np.r_[delta[:3], np.degrees(delta[3:])]
    said = [
        "open" if wide else brief(value)
        for value, wide in zip(values, sd >= HAND_PRECISION, strict=True)
    ]
    return f"{'  '.join(said[:3])} mm along and {'  '.join(said[3:])}°"


def brief(value: float) -> str:
    """Two digits, or a whole number."""
    return f"{value:.2g}" if abs(value) < 100 else f"{value:.0f}"


def robot_errors(noise: Noise) -> str:
    """How large the robot's errors are, at each place where they arise."""
    places = ("at each visit", "at each pose", "shared by the poses of an orientation")
    there = zip(
        places,
        np.reshape([getattr(noise, name) for name in ROBOT], (3, 2)),
        strict=True,
    )
    said = [
        f"{place} {mm:.2g} mm and {deg:.2g}°"
        for place, (mm, deg) in there
        if max(mm, deg) > FINEST_MM
    ]
    return ", ".join(said) or "none that the residuals show"


def verification_text(found: Verification) -> str:
    """What `profilecal verify` prints."""
    (scan,), alone = found.alone.scans, found.alone
    lines = [f"scan alone     {alone.status}"]
    if alone.status != "ok":
        lines[0] += ", so also looked at near the pose"
        lines += [f"note           {message}" for message in alone.messages]
    worst, count, covariance = (
        np.argmax(np.abs(found.apart)),
        len(found.apart),
        found.expected.covariance,
    )
    direction = name_direction(
        found.expected.directions[6 - count + worst], np.eye(3), "sensor"
    )
    lines += [
        f"differs by     {deviations(covariance, found.delta)} about the sensor's x, y, z",
        f"expected       {deviations(covariance)}, one standard deviation",
        f"most apart     {direction}, {brief(abs(found.apart[worst]))} standard deviations",
        f"chance         {found.chance:.2g} of more between right answers, in {count} of 6 directions; "
        f"doubted below {FALSE_ALARM:g}",
    ]
    for name, length in found.lengths.items():
        lines.append(
            f"{name:<15}{length:.3f} mm by the pose, {scan.measures[name]:g} given"
        )
    lines.append(
        f"residuals      {found.rms_mm:.3g} mm rms from a {scan.target.shape}, by the pose"
    )
    wrong = "more is wrong than the stated uncertainties explain: robot, target, or calibration"
    verdict = (
        "the stated uncertainties explain what was found"
        if found.as_expected
        else wrong
    )
    return "\n".join([*lines, f"verdict        {verdict}"])
