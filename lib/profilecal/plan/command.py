"""`profilecal plan`: a specification or a scan in, a prediction or a plan out."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from profilecal.calibrate.calibration import calibrate
from profilecal.calibrate.observe import observe, stated_noise
from profilecal.joint.observability import turns
from profilecal.plan.entries import read_wishes, setup_of
from profilecal.plan.folder import write_plans
from profilecal.plan.mend import OPEN, apart, is_open, mending, other_target, setup_of_scan
from profilecal.plan.plan import Plan, Wishes, design_together, merged
from profilecal.plan.setup import Part, Prediction, Setup, predict
from profilecal.scan.folder import read_scan
from profilecal.scan.scan import Scan, ScanError
from profilecal.scan.toml import read_toml
from profilecal.simulate.guess import planned_poses
from profilecal.simulate.spec import read_specs

ENOUGH_TURN_DEG = 10.0  # rms, apart from turns about one axis: motions that `check` need not worry about


@dataclass(frozen=True)
class Task:
    """What there is to plan."""

    setups: list[Setup]  # one for each target
    wishes: Wishes
    rng: np.random.Generator
    after: list[Part]
    convention: str
    stated: dict[str, float]
    title: str
    entries: dict | None  # of the specification


def task(spec: Path, after: Sequence[Path] = (), **options) -> Task:
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
        wishes, rng = replace(Wishes(limits=limits), **options), np.random.default_rng(0)
        title = f"more poses for {scan.title or spec.resolve().name}"[:200]
        return Task([setup], wishes, rng, [before], scan.convention, stated_noise([scan]), title, None)
    entries = read_toml(spec)
    wishes = replace(read_wishes(entries), **options)
    found, stated = read_specs(entries, spec), entries.get("noise", {})
    rng = np.random.default_rng(found[0].seed)
    setups = [setup_of(one, stated, rng) for one in found]
    before = [part_of_scan(setups, folder) for folder in after]
    title = found[0].title or "planned " + " and ".join(dict.fromkeys(one.kind for one in found))
    return Task(setups, wishes, rng, before, found[0].convention, stated, title, entries)


def part_of_scan(setups: list[Setup], folder: Path) -> Part:
    """The poses of a scan that show its target: the nearest of these of its kind, or else another one, which stands
    where a sensor mounted as they have it sees it. Raises ScanError."""
    scan, first = read_scan(folder), setups[0]
    mount = "eye-to-hand" if first.to_hand else "eye-in-hand"
    if scan.mount != mount:
        raise ScanError(f"{folder} is {scan.mount}; the plan is {mount}")
    seen = observe(scan, 1)
    there = other_target(first, scan, seen)
    alike = [setup for setup in setups if (setup.target.kind, setup.sizes) == (scan.kind, scan.sizes)]
    setup = min(alike, key=lambda setup: apart(setup.target, there.target), default=there)
    return setup, *scan.base_flange(seen.poses)


def prediction_of(task: Task, given: Sequence[Path]) -> Prediction:
    """What the poses of folders or files poses.csv will be worth, after those that are there already; of several
    targets, one for each. Raises ScanError."""
    if len(given) != len(task.setups) > 1:
        raise ScanError(f"there are {len(task.setups)} targets; expected --of as often, in their order")
    found = [planned_poses(place, task.setups[0].to_hand) for place in given]
    setups = task.setups if len(task.setups) > 1 else task.setups * len(given)
    parts = [(setup, poses["R"], poses["T"]) for setup, poses in zip(setups, found, strict=True)]
    return predict(merged([*parts, *task.after]), task.rng)


def designed(task: Task) -> list[Plan]:
    """The plans, one for each target."""
    return design_together(task.setups, task.wishes, task.rng, task.after)


def write(task: Task, plans: list[Plan], folder: Path) -> dict[str, Plan]:
    """The plans' folder; they by the names of their own folders in it."""
    options = {"convention": task.convention, "stated": task.stated, "entries": task.entries, "title": task.title}
    return write_plans(plans, folder, **options)


def mending_of(scan: Scan, folder: Path, seed: int) -> str:
    """`mend.mending` for a scan whose orientations hardly differ but for turns about one axis, before anybody
    calibrates it."""
    if np.linalg.norm(turns(scan.R_base_flange)[0][1:]) >= ENOUGH_TURN_DEG:
        return ""
    try:
        return mending(calibrate([scan]), folder, np.random.default_rng(seed))
    except ScanError:
        return ""
