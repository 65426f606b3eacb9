"""`profilecal plan`: a specification or a scan in; a prediction, or a plan and its folder out."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from profilecal.calibrate.calibration import Calibration, calibrate
from profilecal.calibrate.summary import deviations
from profilecal.geometry.noise import ROBOT
from profilecal.joint.observability import name_direction, size_direction
from profilecal.plan.candidates import Limits
from profilecal.plan.design import NOWHERE, Plan, design, joined
from profilecal.plan.known import model_of_scan, model_of_spec, read_plan
from profilecal.plan.scan_model import GUESSES, Prediction, ScanModel, predict
from profilecal.scan.folder import poses_columns, read_scan
from profilecal.scan.scan import Scan, ScanError
from profilecal.scan.tables import write_table
from profilecal.scan.toml import read_toml, toml_text
from profilecal.simulate.guess import planned_poses
from profilecal.simulate.spec import Spec, read_spec


@dataclass(frozen=True)
class Task:
    """What there is to plan."""

    model: ScanModel
    limits: Limits
    asked: dict  # options of `design`
    rng: np.random.Generator
    source: Spec | Scan
    noise: dict[str, float]  # as stated there
    entries: dict | None = None  # of the specification
    before: tuple = NOWHERE  # poses R (P, 3, 3), T (P, 3) that are there already

    def prediction_of(self, place: Path) -> Prediction:
        """What the poses of a folder or a file will be worth, after those that are there already. Raises ScanError."""
        given = planned_poses(place, self.model.to_hand)
        return predict(self.model, *joined(self.before, (given["R"], given["T"])), self.rng)

    def plan(self) -> Plan:
        """The poses that serve best. Raises ScanError."""
        return design(self.model, self.limits, self.rng, before=self.before, **self.asked)


def task(spec: Path, poses: int | None = None, until: tuple | None = None) -> Task:
    """From a file SPEC.toml or a scan folder; `poses` and `until` go before what it says. Raises ScanError."""
    given = {"poses": poses or 0} if poses or until else {}
    given |= {"until": until} if until else {}
    if spec.is_dir():
        scan = read_scan(spec)
        model, limits, before = model_of_scan(calibrate([scan]))
        return Task(model, limits, given, np.random.default_rng(0), scan, scan.noise, before=before)
    entries = read_toml(spec)
    found, noise = read_spec(entries, spec), entries.get("noise", {})
    limits, asked = read_plan(entries.get("plan", {}), spec)
    rng = np.random.default_rng(found.seed)
    return Task(model_of_spec(found, noise, rng), limits, asked | given, rng, found, noise, entries)


def write_plan(task: Task, plan: Plan, folder: Path) -> None:
    """Write a plan into a folder that exists: a scan folder without measurements; from a specification, one that
    simulates these as well, with the robot's errors that the prediction counts with."""
    model, labels = plan.model, [f"{k:03d}" for k in range(1, len(plan.T) + 1)]
    write_table(folder / "poses.csv", poses_columns(labels, *plan.robot_poses, task.source.convention))
    target = {"kind": model.target.kind} | dict(zip(model.target.lengths, model.sizes, strict=True))
    header = {"title": task.source.title or f"planned {model.target.kind}", "units": "mm", "mount": task.source.mount}
    files = {"scan.toml": header | {"target": target, "noise": task.noise}}
    if task.entries:
        noise = task.noise | {name: getattr(model.noise, name) for name in ROBOT}
        files["simulate.toml"] = task.entries | {"plan": {}, "poses": "poses.csv", "noise": noise}
    for name, entries in files.items():
        (folder / name).write_text(toml_text(entries), encoding="utf-8")


def believed(model: ScanModel) -> list[str]:
    """What a prediction counts with, in lines."""
    n = model.noise
    robot = (
        f"{n.position_mm:.2g} mm and {n.orientation_deg:.2g}° at each pose, {n.group_position_mm:.2g} mm and "
        f"{n.group_orientation_deg:.2g}° at each orientation, {n.repeatability_mm:.2g} mm and "
        f"{n.repeatability_deg:.2g}° at each visit"
    )
    return [f"noise          {n.profile_mm:.2g} mm of a feature's coordinates", f"robot errors   {robot}"]


def predicted(found: Prediction, model: ScanModel) -> list[str]:
    """A prediction in lines."""
    sd, direction = found.spectrum.sd[0], found.spectrum.directions[0]
    weakest = name_direction(direction, model.R_sensor, "base" if model.to_hand else "flange")
    lines = [
        f"status         {found.spectrum.status}, predicted for {found.poses} poses",
        f"one sd         {deviations(found.covariance)} about the sensor's x, y, z",
        f"worst          {found.mm:.2g} mm and {found.deg:.2g}° in any direction",
        f"weakest        {weakest}, {size_direction(sd, direction) if sd < 10 else 'open'}",
    ]
    if found.between:
        (mm, deg), (most_mm, most_deg) = found.between
        between = f"{mm:.2g} to {most_mm:.2g} mm and {deg:.2g} to {most_deg:.2g}°"
        lines.insert(3, f"               {between} in {GUESSES} draws of how wrong the guess is")
    if found.poses < 15:  # which tell the size of the errors to about 15 %
        lines.append("note           few poses: what calibrate states will scatter widely")
    return lines


def to_text(plan: Plan, asked: dict) -> str:
    """A plan in lines."""
    (mm, deg), found = plan.until, plan.predicted
    lines = [*believed(plan.model), *predicted(found, plan.model)]
    if not asked.get("poses") and (found.mm > mm or found.deg > deg):
        lines.append(f"note           {len(plan.T)} poses are not enough for {mm:g} mm and {deg:g}°")
    return "\n".join(lines)


def next_poses(found: Calibration, folder: Path, rng: np.random.Generator) -> str:
    """Which poses would help an answer that is weak, in a sentence; "" where nothing would."""
    if found.misread or len(found.scans) > 1:
        return ""
    try:
        model, limits, before = model_of_scan(found)
        plan = design(model, limits, rng, most=8, before=before, candidates=300)
    except ScanError:
        return ""
    p = plan.predicted
    if p.spectrum.status != "ok":
        return ""
    n = len(plan.T)
    return f"{n} poses more would give {p.mm:.2g} mm and {p.deg:.2g}°: profilecal plan {folder} NEW-FOLDER --poses {n}"
