"""From a specification or a scan to a plan, and its folder."""

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator, default_rng

from profilecal.calibration.calibrate import calibrate
from profilecal.calibration.calibration import Calibration
from profilecal.calibration.observe import LEAST_POSES
from profilecal.joint.prior import prior_from
from profilecal.scan.folder import header_of, poses_columns, read_scan
from profilecal.scan.tables import ScanError, write_table
from profilecal.scan.toml import Entries, read_toml, toml_text
from profilecal.simulation.sweeps import Motion
from profilecal_tool.plan.design import FEW, Plan, along_lines, design
from profilecal_tool.plan.knowledge import model_of_scan, model_of_spec
from profilecal_tool.plan.scan_model import ScanModel, predict
from profilecal_tool.plan.specification import planned_poses, read_specification
from profilecal_tool.plan.words import worst

LINES = (4, 6, 8, 12, 16, 24, 32, 48)  # tried, until they suffice


@dataclass(frozen=True)
class Task:
    """What is to be planned, and what is known."""

    model: ScanModel
    rng: Generator
    source: Any  # the specification, or the scan
    stated: Mapping[str, float]  # of the errors
    # of the specification, without which there is nothing to simulate
    entries: Entries
    motion: Motion | None

    def plan(self) -> Plan:
        """The poses that serve best; in motion, lines through poses. Raises
        ScanError.
        """
        model, rng, asked = self.model, self.rng, self.model.limits.poses
        if self.motion:
            most = asked or model.limits.most
            for count in [asked] if asked else LINES:
                lines = min(count, most)
                plan = along_lines(design(model, rng, poses=lines), self.motion, rng)
                if lines == most or not plan.falls_short:
                    break
            return plan
        plan = design(model, rng)
        if plan.falls_short and not asked and model.guess:
            # do only the margins of the guess keep it from what is wanted?
            exact = design(replace(model, guess=None), rng)
            if not exact.falls_short:
                few = min(FEW, model.limits.most)
                plan = replace(design(model, rng, poses=few), is_first_step=True)
        return plan

    def plan_of(self, place: Path) -> Plan:
        """The poses of a folder or a file as a plan, as far as they have the target in
        view. They come after those that are there already. Raises ScanError.
        """
        model, scanner, said = self.model, self.model.scanner, planned_poses(place)
        if "s1 begin" in said["labels"]:
            raise ScanError(f"{place} has sweeps; expected poses at rest")
        R, T = model.in_base(said["R_base_flange"], said["p_base_flange"])
        x, z = model.middle_seen(*model.planes(R, T)).T
        seen = (scanner.near <= z) & (z <= scanner.far)
        seen &= np.abs(x) <= scanner.half_width(z)
        if not seen.any():
            raise ScanError(
                f"{place}: no pose has the target in view; "
                "are sensor and target where they are guessed?"
            )
        R, T = R[seen], T[seen]
        predicted = predict(model, R, T, self.rng)
        return Plan(model, R, T, predicted, unseen=np.sum(~seen))

    def write(self, plan: Plan, folder: Path) -> None:
        """Write a plan: a scan folder but for the measurements, and the specification
        that simulates them.
        """
        source, table, numbers = self.source, "poses", range(len(plan.T))
        labels = [f"{k + 1:03}" for k in numbers]
        if plan.speed:
            table, ends = "sweeps", ("begin", "end")
            labels = [f"s{k // 2 + 1} {ends[k % 2]}" for k in numbers]
        columns = poses_columns(*self.model.in_base(plan.R, plan.T), source.convention)
        write_table(folder / f"{table}.csv", {"pose": labels} | columns)
        title = source.title or f"planned {source.kind}"
        texts = {"scan": header_of(source, title, self.stated)}
        if self.entries:
            noise = {**self.stated, **prior_from(self.stated).scales.of_robot}
            changed = {"poses": f"{table}.csv", "noise": noise}
            texts["simulate"] = self.entries | changed
        for name, entries in texts.items():
            text = toml_text(entries)
            (folder / f"{name}.toml").write_text(text, encoding="utf-8")


def read_task(
    path: Path,
    poses: int | None = None,
    until: tuple[float, float] | None = None,
    within: Path | None = None,
) -> Task:
    """What a specification asks for, or what follows a scan folder, `within` the
    limits of a specification. `poses` or `until` replace what it wants. Raises
    ScanError.
    """
    is_scan = path.is_dir()
    if within and not is_scan:
        raise ScanError(f"{path} is no scan folder; expected one beside --within")
    place = within if is_scan else path
    entries = read_toml(place) if place else {}
    spec = read_specification(entries, place or path)
    rng = default_rng(spec.seed)
    if is_scan:
        source, motion = read_scan(path), None
        if place and spec.kind != source.kind:
            raise ScanError(f"{place}: kind is {spec.kind}; expected {source.kind}")
        stated, model = source.noise, model_of_scan(calibrate(source))
    else:
        source, motion, stated = spec, spec.motion, entries.get("noise", {})
        model = model_of_spec(spec, stated, rng)
    limits = spec.plan if place else model.limits
    if poses or until:
        limits = replace(limits, poses=poses or 0, until=until or limits.until)
    if is_scan and 0 < limits.poses < LEAST_POSES:
        raise ScanError(
            f"poses is {limits.poses}; expected {LEAST_POSES} or more: they tell where "
            "the target stands then"
        )
    if motion and not (limits.poses or limits.until):
        limits = replace(limits, poses=(motion.sweeps + 1) // 2)
    return Task(replace(model, limits=limits), rng, source, stated, entries, motion)


def next_poses(found: Calibration, folder: Path) -> list[str]:
    """Which poses more would make a weak answer a good one, in words; none where a few
    would not.
    """
    if len(found.scans) > 1:
        return []
    try:
        model = model_of_scan(found)
        plan = design(model, default_rng(0), most=8, candidates=300)
    except ScanError:
        return []
    if plan.predicted.status != "ok":
        return []
    count, place = len(plan.T), shlex.quote(str(folder))
    command = f"profilecal plan {place} NEW-FOLDER --poses {count}"
    return [f"{count} poses more would give {worst(plan.predicted)}: {command}"]
