"""The plan that is asked for: its task, and its folder."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from profilecal.calibration.calibrate import calibrate
from profilecal.calibration.calibration import Calibration
from profilecal.geometry.poses import Frames
from profilecal.joint.prior import prior_from
from profilecal.scan.folder import header_of, poses_columns, read_scan
from profilecal.scan.scan import Scan, ScanError
from profilecal.scan.tables import write_table
from profilecal.scan.toml import read_toml, toml_text
from profilecal.simulation.sweeps import Motion
from profilecal_tool.plan.candidates import joined
from profilecal_tool.plan.design import FEW, NOWHERE, Plan, design
from profilecal_tool.plan.knowledge import model_of_scan, model_of_spec
from profilecal_tool.plan.scan_model import ScanModel, predict
from profilecal_tool.plan.specification import (
    PlannedSpec,
    planned_poses,
    read_specification,
)
from profilecal_tool.plan.sweeps import along_lines
from profilecal_tool.plan.words import worst

LINES = (4, 6, 8, 12, 16, 24, 32, 48)  # of plans of sweeps that are tried in turn


@dataclass(frozen=True)
class Task:
    """What there is to plan."""

    model: ScanModel
    rng: np.random.Generator
    # whose mount, target and convention the folder states
    source: PlannedSpec | Scan
    # the noise that it states
    stated: Mapping[str, float]
    # the content of the specification; none: the folder cannot be simulated
    entries: Mapping
    # how the robot moves; None: it stops for each profile
    motion: Motion | None = None
    # poses R (P, 3, 3), T (P, 3) that are there already
    before: Frames = NOWHERE

    def plan_of(self, place: Path) -> Plan:
        """The poses of a folder or a file as a plan, as far as they have the target in
        view. They come after those that are there already. Raises ScanError.
        """
        _, R, T = planned_poses(place, self.model.to_hand)
        seen = self.model.in_view(R, T)
        if not seen.any():
            raise ScanError(
                f"{place}: no pose has the target in view; "
                "are sensor and target where they are guessed?"
            )
        poses = R[seen], T[seen]
        predicted = predict(self.model, *joined(self.before, poses), self.rng)
        return Plan(self.model, *poses, predicted, unseen=np.sum(~seen))

    def plan(self) -> Plan:
        """The poses that serve best; in motion, lines through poses. Raises
        ScanError.
        """
        motion = self.motion
        if motion is None:
            plan = self.poses()
            if plan.falls_short and not self.count_given and self.two_steps_reach_it():
                plan = replace(self.poses(poses=FEW), is_first_step=True)
            return plan
        counts: Sequence[int] = LINES
        if self.count_given:
            counts = [self.model.limits.poses or (motion.sweeps + 1) // 2]
        for count in counts:
            plan = along_lines(self.poses(poses=count), motion, self.rng)
            if not plan.falls_short:
                break
        return plan

    @property
    def count_given(self) -> bool:
        """Whether so many poses or lines are asked for, not as many as it takes."""
        limits = self.model.limits
        return bool(limits.poses or (self.motion and not limits.until))

    def poses(self, **asked: int) -> Plan:
        """A plan of poses. Raises ScanError."""
        return design(self.model, self.rng, before=self.before, **asked)

    def two_steps_reach_it(self) -> bool:
        """Whether a second plan, from the answer of a first one, reaches what is
        wanted: only the margins of the guess keep this one from it.
        """
        guess = self.model.guess
        if guess is None:
            return False
        exact = replace(guess, mount_mm=0, mount_deg=0, target_mm=0, target_deg=0)
        second = replace(self, model=replace(self.model, guess=exact))
        return not second.poses().falls_short

    def write(self, plan: Plan, folder: Path) -> None:
        """Write a plan of poses or sweeps into a folder that exists.

        It becomes a scan folder without measurements; from a specification, one that
        simulates these as well, with the robot's errors that the prediction counts
        with.
        """
        source, convention = self.source, self.source.convention
        numbers, table = range(len(plan.T)), "poses.csv"
        labels = [f"{k + 1:03d}" for k in numbers]
        if plan.speed:
            table, ends = "sweeps.csv", ("begin", "end")
            labels = [f"s{k // 2 + 1} {ends[k % 2]}" for k in numbers]
        way = poses_columns(*self.model.in_base(plan.R, plan.T), convention)
        write_table(folder / table, {"pose": labels} | way)
        title = source.title or f"planned {source.kind}"
        files = {"scan": header_of(source, title, self.stated)}
        if self.entries:
            noise = {**self.stated, **prior_from(self.stated).scales.of_robot}
            # in place of limits, which a simulation does not need, the planned poses
            changes = {"plan": {}, "poses": table, "noise": noise}
            files["simulate"] = {**self.entries, **changes}
        for name, entries in files.items():
            (folder / f"{name}.toml").write_text(toml_text(entries), "utf-8")


def read_task(
    path: Path,
    poses: int | None = None,
    until: Sequence[float] | None = None,
    within: Path | None = None,
) -> Task:
    """The task that a file SPEC.toml or a scan folder sets.

    `poses` and `until` go before what it says; after a scan, `within` is a SPEC.toml
    that says where the robot may go. Raises ScanError.
    """
    if path.name == "scan.toml":
        path = path.parent
    is_scan = path.is_dir()
    if within and not is_scan:
        raise ScanError(f"{path} is no scan folder; expected one beside --within")
    place = within if is_scan else path
    entries = read_toml(place) if place else {}
    spec = read_specification(entries, place or path)
    rng = np.random.default_rng(spec.seed)
    if is_scan:
        scan = read_scan(path)
        model, before = model_of_scan(calibrate([scan]))
        task = Task(model, rng, scan, scan.noise, entries, before=before)
    else:
        stated = entries.get("noise", {})
        model = model_of_spec(spec, stated, rng)
        task = Task(model, rng, spec, stated, entries, spec.motion)
    limits = spec.plan if place else model.limits
    if poses or until:
        limits = replace(limits, poses=poses or 0, until=until or limits.until)
    return replace(task, model=replace(model, limits=limits))


def next_poses(found: Calibration, folder: Path) -> list[str]:
    """Which poses would help an answer that is weak, in one sentence or in none."""
    if len(found.scans) > 1:
        return []
    try:
        model, before = model_of_scan(found)
        rng = np.random.default_rng(0)
        plan = design(model, rng, most=8, before=before, candidates=300)
    except ScanError:
        return []
    if plan.predicted.spectrum.status != "ok":
        return []
    count = len(plan.T)
    command = f"profilecal plan {folder} NEW-FOLDER --poses {count}"
    return [f"{count} poses more would give {worst(plan.predicted)}: {command}"]
