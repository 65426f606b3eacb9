"""Predictions and plans in words, as `profilecal plan` prints them."""

import shlex
from collections.abc import Iterator
from pathlib import Path

from profilecal_tool.plan.design import FEW, Plan
from profilecal_tool.plan.scan_model import DRAWS, Prediction
from profilecal_tool.words import deviations


def plan_lines(plan: Plan) -> list[str]:
    """A plan in lines, after what its prediction counts with."""
    noise, predicted, count = plan.model.noise, plan.predicted, len(plan.T)
    counted = f"{predicted.poses} poses"
    if plan.speed:
        counted = f"{predicted.poses} profiles"
    elif count < predicted.poses:
        counted += f", {count} of them new"
    lines = [
        f"noise          {noise.profile_mm:.2g} mm of a feature's coordinates",
        f"robot errors   {noise.position_mm:.2g} mm and {noise.orientation_deg:.2g}° "
        f"at each pose, {noise.group_position_mm:.2g} mm and "
        f"{noise.group_orientation_deg:.2g}° at each orientation, "
        f"{noise.repeatability_mm:.2g} mm and {noise.repeatability_deg:.2g}° "
        "at each visit",
        f"status         {predicted.status}, predicted for {counted}",
        f"one sd         {deviations(predicted.covariance)} about the sensor's x, y, z",
        f"worst          {worst(predicted)} in any direction",
    ]
    if predicted.between and worst(predicted) != "open":
        (mm, deg), (most_mm, most_deg) = predicted.between
        between = f"{mm:.2g} to {most_mm:.2g} mm and {deg:.2g} to {most_deg:.2g}°"
        lines.append(f"{'':15}{between} in {DRAWS} draws of how wrong the guess is")
    if plan.speed:
        lines += [
            f"delay          ± {1e3 * predicted.delay_sd_s:.2g} ms",
            f"sweeps         {count // 2}, driven there and back: a delay shifts both "
            "ways apart, a wrong mount does not",
        ]
    lines += [f"left out       {why}" for why in plan.left_out]
    return lines + [f"note           {note}" for note in notes(plan)]


def notes(plan: Plan) -> Iterator[str]:
    """What else there is to say of a plan."""
    count, wished = len(plan.T), "{:g} mm and {:g}°".format(*plan.wanted_sd)
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
    if plan.is_first_step:
        yield (
            "a first step: with a guess as wrong as stated, as many poses as allowed "
            f"do not reach {wished}; a second step, from the answer of these, does"
        )
    elif plan.model.limits.poses or not plan.falls_short:
        return
    elif plan.speed:
        yield f"{count // 2} sweeps do not give {wished}"
    else:
        like = "nor are ten times as many"
        if plan.enough_poses:
            like = f"{plan.enough_poses} like these are"
        yield f"{count} poses are not enough for {wished}; {like}"


def worst(predicted: Prediction) -> str:
    """The largest standard deviations of a prediction."""
    if predicted.status == "unobservable":
        return "open"
    return f"{predicted.mm:.2g} mm and {predicted.deg:.2g}°"


def steps(plan: Plan, spec: Path, folder: Path | None) -> list[str]:
    """What to do with a plan of a specification or a scan, in a folder or in none."""
    if not folder:
        return ["next: the same command with a NEW-FOLDER writes it"]
    if worst(plan.predicted) == "open":
        return [f"{folder}/ written", "next: plan more poses, or larger turns"]
    written = f"{folder}/ written; look at {folder}/plan.png, drive {folder}"
    known, new = map(shlex.quote, map(str, (spec, folder)))
    if plan.speed:
        return [
            f"{written}/sweeps.csv at {plan.speed:g} mm/s, from each begin to its end",
            "next: put log.csv and the measurements with sweep and t beside it "
            f"(data/README.md: In motion), then profilecal calibrate {new}",
        ]
    target, is_scan = plan.model.target, spec.is_dir()
    scans = f"{known} {new}, both at once" if is_scan else new
    lines = [
        f"{written}/poses.csv",
        f"next: put {target.tables[0]}.csv beside it (data/README.md has its columns), "
        f"then profilecal calibrate {scans}",
    ]
    if not is_scan:
        said = [f"--{name} {getattr(target, name):g} " for name in target.size_names]
        said += ["--mount eye-to-hand "] * plan.model.to_hand
        lines.append(
            "or take the scanner's files: profilecal import DIR NEW-FOLDER "
            f"--target {target.kind} {''.join(said)}--poses {new}/poses.csv"
        )
    if plan.is_first_step:
        lines.append(
            f"and then: profilecal plan {new} SECOND-FOLDER "
            f"{'--until {:g} {:g}'.format(*plan.wanted_sd)} --within {known}"
        )
    return lines
