"""Predictions and plans in words, as `profilecal plan` prints them."""

from profilecal.geometry.observability import name_direction, size_direction
from profilecal_tool.plan.design import FEW, Plan
from profilecal_tool.plan.scan_model import GUESSES, Prediction, ScanModel
from profilecal_tool.plan.sweeps import WHY
from profilecal_tool.words import deviations


def believed(model: ScanModel) -> list[str]:
    """What a prediction counts with, in lines."""
    noise = model.noise
    pose = f"{noise.position_mm:.2g} mm and {noise.orientation_deg:.2g}°"
    group = f"{noise.group_position_mm:.2g} mm and {noise.group_orientation_deg:.2g}°"
    visit = f"{noise.repeatability_mm:.2g} mm and {noise.repeatability_deg:.2g}°"
    return [
        f"noise          {noise.profile_mm:.2g} mm of a feature's coordinates",
        f"robot errors   {pose} at each pose, {group} at each orientation, "
        f"{visit} at each visit",
    ]


def prediction_lines(
    prediction: Prediction, model: ScanModel, new: int = 0, unseen: int = 0
) -> list[str]:
    """A prediction in lines, after what it counts with.

    `new`: how many of the poses are planned; `unseen`: how many poses do not have the
    target in view.
    """
    spectrum = prediction.spectrum
    direction = spectrum.directions[0]
    sd = spectrum.sd[0]
    frame = "base" if model.to_hand else "flange"
    weakest = name_direction(direction, model.R_sensor, frame)
    size = size_direction(sd, direction) if sd < 10 else "open"
    sizes = deviations(prediction.covariance)
    what = "profiles" if prediction.delay_sd_s else "poses"
    poses = f"{prediction.poses} {what}"
    if 0 < new < prediction.poses:
        poses += f", {new} of them new"
    lines = [
        *believed(model),
        f"status         {spectrum.status}, predicted for {poses}",
        f"one sd         {sizes} about the sensor's x, y, z",
        f"worst          {worst(prediction)} in any direction",
    ]
    if prediction.between and spectrum.status != "unobservable":
        (mm, deg), (most_mm, most_deg) = prediction.between
        between = f"{mm:.2g} to {most_mm:.2g} mm and {deg:.2g} to {most_deg:.2g}°"
        lines.append(
            f"               {between} in {GUESSES} draws of how wrong the guess is"
        )
    lines.append(f"weakest        {weakest}, {size}")
    if prediction.delay_sd_s:
        delay_ms = 1e3 * prediction.delay_sd_s
        lines.append(f"delay          ± {delay_ms:.2g} ms")
    if unseen:
        lines.append(
            f"note           {unseen} other poses do not have the target in view, "
            "where it is guessed to be"
        )
    if prediction.poses < FEW:
        lines.append(
            "note           few poses: what calibrate states will scatter widely"
        )
    return lines


def worst(prediction: Prediction) -> str:
    """The largest standard deviations of a prediction."""
    if prediction.spectrum.status == "unobservable":
        return "open"
    return f"{prediction.mm:.2g} mm and {prediction.deg:.2g}°"


def plan_lines(plan: Plan, count_given: bool) -> list[str]:
    """A plan in lines; `count_given`: it was to have so many poses and no more."""
    new = 0 if plan.speed else len(plan.T)
    lines = prediction_lines(plan.predicted, plan.model, new)
    mm, deg = plan.until
    wished = f"{mm:g} mm and {deg:g}°"
    if plan.speed:
        count = len(plan.T) // 2
        lines.append(f"sweeps         {count}, {WHY}")
        lines += [f"left out       {why}" for why in plan.left_out]
        if plan.falls_short and not count_given:
            lines.append(f"note           {count} sweeps do not give {wished}")
        return lines
    if plan.is_first_step:
        lines.append(
            "note           a first step: with a guess as wrong as stated, as many "
            f"poses as allowed do not reach {wished}; a second step, from the answer "
            "of these, does"
        )
    elif plan.falls_short and not count_given:
        enough = (
            f"{plan.enough} like these are"
            if plan.enough
            else "nor are ten times as many"
        )
        lines.append(
            f"note           {len(plan.T)} poses are not enough for {wished}; {enough}"
        )
    return lines
