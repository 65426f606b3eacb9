"""The plan that is asked for: its task, and its folder."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from profilecal.calibration.calibration import Calibration, calibrate
from profilecal.geometry.noise import ROBOT
from profilecal.geometry.poses import Frames, inverse
from profilecal.joint.prior import prior_from
from profilecal.scan.folder import poses_columns, read_scan
from profilecal.scan.scan import Scan, ScanError
from profilecal.scan.tables import write_table
from profilecal.scan.toml import read_toml, toml_text
from profilecal.simulation.sweeps import Motion
from profilecal.targets import TARGETS
from profilecal_tool.plan.design import FEW, NOWHERE, Plan, design, joined
from profilecal_tool.plan.knowledge import model_of_scan, model_of_spec, read_plan
from profilecal_tool.plan.scan_model import Prediction, ScanModel, predict
from profilecal_tool.plan.specification import (
    MARGINS,
    PlannedSpec,
    planned_poses,
    read_specification,
)
from profilecal_tool.plan.sweeps import TABLE, WayBack, along_lines, write_sweeps
from profilecal_tool.plan.words import worst

LINES = (4, 6, 8, 12, 16, 24, 32, 48)  # of plans of sweeps that are tried in turn


@dataclass(frozen=True)
class Task:
    """What there is to plan."""

    model: ScanModel
    # options of `design`
    asked: dict
    rng: np.random.Generator
    source: PlannedSpec | Scan
    # as stated there
    noise: dict[str, float]
    # of the specification, if there is one
    entries: dict
    # poses R (P, 3, 3), T (P, 3) that are there already
    before: Frames = NOWHERE
    # whether `calibrate` has something to say against the scan
    doubted: bool = False

    def prediction_of(self, place: Path) -> tuple[Prediction, int]:
        """Predict what the poses of a folder or a file will be worth.

        They come after those that are there already, and count as far as they have the
        target in view; returns also how many have not. Raises ScanError.
        """
        given = planned_poses(place, self.model.to_hand)
        R, T = joined(self.before, (given["R"], given["T"]))
        seen = self.model.in_view(R, T)
        if not seen.any():
            raise ScanError(
                f"{place}: no pose has the target in view; "
                "are sensor and target where they are guessed?"
            )
        return predict(self.model, R[seen], T[seen], self.rng), int((~seen).sum())

    def plan(self) -> Plan:
        """The poses that serve best; where only the margins of the guess keep them from
        what is asked for, those of a first step; in motion, lines through poses.

        Raises ScanError.
        """
        if self.motion:
            return self.in_motion(self.motion)
        plan = self.designed(self.model)
        if self.asked.get("poses") or self.model.guess is None or not plan.falls_short:
            return plan
        margins = dict.fromkeys(MARGINS, 0.0)
        exact = replace(self.model, guess=replace(self.model.guess, **margins))
        if self.designed(exact).falls_short:
            return plan
        return replace(self.designed(self.model, poses=FEW), is_first_step=True)

    def in_motion(self, motion: Motion) -> Plan:
        """Sweeps along so many lines as are asked for, or as serve `until`; else as the
        specification says. Raises ScanError.
        """
        given = self.asked.get("poses") or (motion.sweeps + 1) // 2
        for lines in (given,) if self.count_given else LINES:
            through = self.designed(self.model, poses=lines)
            plan = along_lines(through, motion, self.rng)
            if not plan.falls_short:
                break
        return plan

    @property
    def motion(self) -> Motion | None:
        """How the robot moves, if it does."""
        return getattr(self.source, "motion", None)

    @property
    def count_given(self) -> bool:
        """Whether so many poses or lines are asked for, not as many as it takes."""
        by_motion = self.motion and "until" not in self.asked
        return bool(by_motion or self.asked.get("poses"))

    @property
    def doubts(self) -> list[str]:
        """What a prediction after this scan leaves out, in a line or none."""
        if not self.doubted:
            return []
        return [
            "note           calibrate finds an error in this scan; "
            "while that lasts, it will state more than is predicted"
        ]

    def designed(self, model: ScanModel, **more: int) -> Plan:
        """A plan for the model, or for one like it. Raises ScanError."""
        return design(model, self.rng, before=self.before, **self.asked | more)


def read_task(
    path: Path,
    poses: int | None = None,
    until: tuple | None = None,
    within: Path | None = None,
) -> Task | WayBack:
    """The task that a file SPEC.toml or a scan folder sets; the way back of a scan
    whose sweeps hide the delay.

    `poses` and `until` go before what it says; after a scan, `within` is a SPEC.toml
    that says where the robot may go. Raises ScanError.
    """
    given: dict = {"poses": poses or 0} if poses or until else {}
    if until:
        given["until"] = until
    if path.name == "scan.toml":
        path = path.parent
    place = within or path
    entries = {}
    if not place.is_dir():
        entries = read_toml(place)
        spec = read_specification(entries, place)
    limits, asked = read_plan(entries.get("plan", {}), place)
    asked |= given
    if path.is_dir():
        scan = read_scan(path)
        found = calibrate([scan])
        if back := WayBack.of(found):
            return back
        model, before = model_of_scan(found)
        if within:
            model = replace(model, limits=limits)
        rng, noise = np.random.default_rng(0), dict(scan.noise)
        doubted = found.misread
        return Task(model, asked, rng, scan, noise, entries, before, doubted)
    noise = entries.get("noise", {})
    rng = np.random.default_rng(spec.seed)
    model = replace(model_of_spec(spec, noise, rng), limits=limits)
    return Task(model, asked, rng, spec, noise, entries)


def write_plan(task: Task, plan: Plan, folder: Path) -> None:
    """Write a plan of poses or sweeps into a folder that exists.

    It becomes a scan folder without measurements; from a specification, one that
    simulates these as well, with the robot's errors that the prediction counts with.
    """
    model = plan.model
    labels = [f"{k:03d}" for k in range(1, len(plan.T) + 1)]
    R, T = inverse(plan.R, plan.T) if model.to_hand else (plan.R, plan.T)
    table = "poses.csv"
    if plan.speed:
        table = TABLE
        write_sweeps(folder / table, R, T, task.source.convention)
    else:
        columns = poses_columns(labels, R, T, task.source.convention)
        write_table(folder / table, columns)
    write_header(folder, task.source, model.target.kind, model.sizes, task.noise)
    if task.entries:
        noise = task.entries.get("noise", {})
        scales = prior_from(noise).scales
        robot = {name: getattr(scales, name) for name in ROBOT}
        changes = {"plan": {}, "poses": table, "noise": noise | robot}
        text = toml_text(task.entries | changes)
        (folder / "simulate.toml").write_text(text, encoding="utf-8")


def write_way_back(back: WayBack, folder: Path) -> None:
    """Write the way back of a scan into a folder that exists, a scan folder without
    measurements.
    """
    scan = back.scan
    write_sweeps(folder / TABLE, back.R, back.p, scan.convention)
    write_header(folder, scan, scan.kind, scan.sizes, scan.noise)


def write_header(
    folder: Path,
    source: PlannedSpec | Scan,
    kind: str,
    sizes: Sequence[float],
    noise: Mapping[str, float],
) -> None:
    """Write scan.toml for a target of these sizes, mm."""
    lengths = zip(TARGETS[kind].lengths, sizes, strict=True)
    header = {
        "title": source.title or f"planned {kind}",
        "units": "mm",
        "mount": source.mount,
        "target": {"kind": kind, **dict(lengths)},
        "noise": dict(noise),
    }
    (folder / "scan.toml").write_text(toml_text(header), encoding="utf-8")


def next_poses(calibration: Calibration, folder: Path) -> list[str]:
    """Which poses would help an answer that is weak, in one sentence or in none."""
    if len(calibration.scans) > 1:
        return []
    try:
        model, before = model_of_scan(calibration)
        rng = np.random.default_rng(0)
        plan = design(model, rng, most=8, before=before, candidates=300)
    except ScanError:
        return []
    if plan.predicted.spectrum.status != "ok":
        return []
    count = len(plan.T)
    command = f"profilecal plan {folder} NEW-FOLDER --poses {count}"
    return [f"{count} poses more would give {worst(plan.predicted)}: {command}"]
