"""Predictions and plans in words, as `profilecal plan` prints them."""

from collections.abc import Iterator
from pathlib import Path

from profilecal.geometry.observability import name_direction, size_direction
from profilecal_tool.plan.design import FEW, Plan
from profilecal_tool.plan.scan_model import GUESSES, Prediction
from profilecal_tool.words import deviations


def plan_lines(plan: Plan, as_asked: bool) -> list[str]:
    """A plan in lines, after what its prediction counts with; `as_asked`: it was to
    have these poses and no others.
    """
    model, prediction = plan.model, plan.predicted
    noise, spectrum, count = model.noise, prediction.spectrum, len(plan.T)
    direction, sd = spectrum.directions[0], spectrum.sd[0]
    frame = "base" if model.to_hand else "flange"
    weakest = name_direction(direction, model.R_sensor, frame)
    size = size_direction(sd, direction) if sd < 10 else "open"
    what, some_new = "poses", ""
    if plan.speed:
        what = "profiles"
    elif count < prediction.poses:
        some_new = f", {count} of them new"
    lines = [
        f"noise          {noise.profile_mm:.2g} mm of a feature's coordinates",
        f"robot errors   {noise.position_mm:.2g} mm and {noise.orientation_deg:.2g}° "
        f"at each pose, {noise.group_position_mm:.2g} mm and "
        f"{noise.group_orientation_deg:.2g}° at each orientation, "
        f"{noise.repeatability_mm:.2g} mm and {noise.repeatability_deg:.2g}° "
        "at each visit",
        f"status         {spectrum.status}, "
        f"predicted for {prediction.poses} {what}{some_new}",
        f"one sd         {deviations(prediction.covariance)} "
        "about the sensor's x, y, z",
        f"worst          {worst(prediction)} in any direction",
    ]
    if prediction.between and spectrum.status != "unobservable":
        (mm, deg), (most_mm, most_deg) = prediction.between
        between = f"{mm:.2g} to {most_mm:.2g} mm and {deg:.2g} to {most_deg:.2g}°"
        lines.append(
            f"               {between} in {GUESSES} draws of how wrong the guess is"
        )
    lines.append(f"weakest        {weakest}, {size}")
    if plan.speed:
        lines += [
            f"delay          ± {1e3 * prediction.delay_sd_s:.2g} ms",
            f"sweeps         {count // 2}, driven there and back: a delay shifts both "
            "ways apart, a wrong mount does not",
            *(f"left out       {why}" for why in plan.left_out),
        ]
    return lines + [f"note           {note}" for note in notes(plan, as_asked)]


def notes(plan: Plan, as_asked: bool) -> Iterator[str]:
    """What else there is to say of a plan."""
    if plan.unseen:
        yield (
            f"{plan.unseen} other poses do not have the target in view, "
            "where it is guessed to be"
        )
    if plan.predicted.poses < FEW:
        yield "few poses: what calibrate states will scatter widely"
    if plan.model.doubted:
        yield (
            "calibrate finds an error in this scan; "
            "while that lasts, it will state more than is predicted"
        )
    count, wished = len(plan.T), "{:g} mm and {:g}°".format(*plan.wanted_sd)
    if plan.is_first_step:
        yield (
            "a first step: with a guess as wrong as stated, as many poses as allowed "
            f"do not reach {wished}; a second step, from the answer of these, does"
        )
    elif as_asked or not plan.falls_short:
        return
    elif plan.speed:
        yield f"{count // 2} sweeps do not give {wished}"
    else:
        like = "nor are ten times as many"
        if plan.enough_poses:
            like = f"{plan.enough_poses} like these are"
        yield f"{count} poses are not enough for {wished}; {like}"


def worst(prediction: Prediction) -> str:
    """The largest standard deviations of a prediction."""
    if prediction.spectrum.status == "unobservable":
        return "open"
    return f"{prediction.mm:.2g} mm and {prediction.deg:.2g}°"


def steps(plan: Plan, spec: Path, folder: Path | None) -> list[str]:
    """What to do with a plan of a specification or a scan, in a folder or in none."""
    if not folder:
        return [f"next: profilecal plan {spec} NEW-FOLDER writes it"]
    written = f"{folder}/ written; look at {folder / 'plan.png'}, drive "
    if plan.speed:
        return [
            f"{written}{folder / 'sweeps.csv'} at {plan.speed:g} mm/s, from each begin "
            "to its end",
            "next: put log.csv and the measurements with sweep and t beside it "
            f"(data/README.md: In motion), then profilecal calibrate {folder}",
        ]
    if plan.predicted.spectrum.status == "unobservable":
        return [f"{folder}/ written", "next: plan more poses, or larger turns"]
    target, is_scan = plan.model.target, spec.is_dir()
    scans = f"{spec} {folder}, both at once" if is_scan else folder
    lines = [
        f"{written}{folder / 'poses.csv'}",
        f"next: put {target.tables[0]}.csv beside it (data/README.md has its columns), "
        f"then profilecal calibrate {scans}",
    ]
    if not is_scan:
        lengths = [f" --{name} {getattr(target, name):g}" for name in target.lengths]
        mount = " --mount eye-to-hand" if plan.model.to_hand else ""
        lines.append(
            "or take the scanner's files: profilecal import DIR NEW-FOLDER "
            f"--target {target.kind}{''.join(lengths)}{mount} "
            f"--poses {folder / 'poses.csv'}"
        )
    if plan.is_first_step:
        mm, deg = plan.wanted_sd
        lines.append(
            f"and then: profilecal plan {folder} SECOND-FOLDER "
            f"--until {mm:g} {deg:g} --within {spec}"
        )
    return lines
