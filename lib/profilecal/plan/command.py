"""`profilecal plan`: a specification or a scan in, a prediction or a plan out."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from profilecal.calibrate.calibration import calibrate
from profilecal.calibrate.observe import observe, stated_noise
from profilecal.joint.observability import turns
from profilecal.plan.folder import write_plan
from profilecal.plan.mend import OPEN, is_open, mending, setup_of_scan
from profilecal.plan.plan import Plan, Wishes, design, read_wishes, setup_of
from profilecal.plan.setup import Part, Prediction, Setup, predict
from profilecal.scan.folder import read_scan
from profilecal.scan.scan import Scan, ScanError
from profilecal.scan.tables import read_toml
from profilecal.simulate.guess import planned_poses
from profilecal.simulate.spec import read_spec

ENOUGH_TURN_DEG = 10.0  # about the least axis: motions that `check` need not worry about


@dataclass(frozen=True)
class Task:
    """What there is to plan."""

    setup: Setup
    wishes: Wishes
    rng: np.random.Generator
    after: Part | None
    convention: str
    stated: dict[str, float]
    title: str
    entries: dict | None  # of the specification


def task(spec: Path, after: Path | None, **options) -> Task:
    """From a file SPEC.toml or a scan folder. `options`: fields of `Wishes` that are not None go before what is in the
    file. Raises ScanError."""
    options = {name: value for name, value in options.items() if value is not None}
    if "until" in options:
        options = {"poses": 0} | options
    if spec.is_dir():
        if after:
            raise ScanError(f"{spec} is a scan folder itself; --after is for a specification")
        scan = read_scan(spec)
        found = calibrate([scan])
        setup, limits, before = setup_of_scan(found)
        if is_open(found):
            raise ScanError(f"{spec}: {OPEN}")
        wishes = replace(Wishes(limits=limits), **options)
        title = f"more poses for {scan.title or spec.resolve().name}"[:200]
        return Task(setup, wishes, np.random.default_rng(0), before, scan.convention, stated_noise([scan]), title, None)
    entries = read_toml(spec)
    wishes = replace(read_wishes(entries), **options)
    found, stated = read_spec(entries, spec.parent), entries.get("noise", {})
    rng = np.random.default_rng(found.seed)
    setup = setup_of(found, stated, rng)
    before = (setup, *poses_of_scan(setup, after)) if after else None
    title = found.title or f"planned {found.kind}"
    return Task(setup, wishes, rng, before, found.convention, stated, title, entries)


def poses_of_scan(setup: Setup, folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """The poses of a scan of the same target that show it. Raises ScanError."""
    scan = read_scan(folder)
    mount = "eye-to-hand" if setup.to_hand else "eye-in-hand"
    if (scan.kind, scan.mount) != (setup.target.kind, mount):
        raise ScanError(f"{folder} is of a {scan.kind}, {scan.mount}; the plan is for a {setup.target.kind}, {mount}")
    return scan.base_flange(observe(scan, 1).poses)


def prediction_of(task: Task, given: Path) -> tuple[Setup, Prediction]:
    """What the poses of a folder or a file poses.csv will be worth, after those that are there already."""
    found = planned_poses(given, task.setup.to_hand)
    parts = [(found["R"], found["T"]), *([task.after[1:]] if task.after else [])]
    return task.setup, predict([(task.setup, *(np.concatenate(part) for part in zip(*parts, strict=True)))])


def designed(task: Task) -> Plan:
    """The plan."""
    return design(task.setup, task.wishes, task.rng, task.after)


def write(task: Task, plan: Plan, folder: Path) -> None:
    """The plan's folder."""
    write_plan(plan, folder, convention=task.convention, stated=task.stated, entries=task.entries, title=task.title)


def mending_of(scan: Scan, folder: Path, seed: int) -> str:
    """`mend.mending` for a scan whose orientations hardly differ about some axis, before anybody calibrates it."""
    if turns(scan.R_base_flange)[0][2] >= ENOUGH_TURN_DEG:
        return ""
    try:
        return mending(calibrate([scan]), folder, np.random.default_rng(seed))
    except ScanError:
        return ""
