"""From a specification or a scan to what is known beforehand, and from there to the
plan that the command writes.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from profilecal.calibration.calibration import Calibration, calibrate
from profilecal.calibration.observe import as_observations, observe, stated_noise
from profilecal.geometry.noise import ROBOT
from profilecal.geometry.observability import name_direction, size_direction
from profilecal.geometry.poses import inverse, nearest_rotation
from profilecal.joint.prior import prior_from
from profilecal.scan.folder import poses_columns, read_scan
from profilecal.scan.scan import Scan, ScanError
from profilecal.scan.tables import write_table
from profilecal.scan.toml import (
    check_entries,
    number,
    numbers,
    read_toml,
    toml_text,
    whole,
)
from profilecal.simulation.robot import Scanner
from profilecal.simulation.spec import (
    Spec,
    planned_poses,
    raw_profiles,
    read_spec,
    sizes_of,
)
from profilecal.targets import TARGETS
from profilecal.targets.observations import Observations
from profilecal_tool.plan.candidates import Limits, draw, off_square
from profilecal_tool.plan.design import NOWHERE, Plan, design, joined
from profilecal_tool.plan.scan_model import GUESSES, Prediction, ScanModel, predict
from profilecal_tool.words import deviations

PLAN = {
    "poses": whole(0, 1000),
    "most": whole(1, 1000),
    "until": numbers(2),
    "low": numbers(3),
    "high": numbers(3),
    "tilt_deg": number(0, 80),
    "spin_deg": number(0, 180),
    "extent_mm": number(0, 1000),
    "avoid": (
        lambda value: (
            isinstance(value, list) and all(numbers(4)[0](zone) for zone in value)
        ),
        "a list of zones, each of four numbers: x, y, z, radius",
    ),
}


def read_plan(table: dict, path) -> tuple[Limits, dict]:
    """The table [plan] of a specification: where the robot may go, and what is asked of
    `design`. Raises ScanError.
    """
    check_entries(path, table, PLAN, "plan")
    given = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in table.items()
    }
    asked = {
        name: given.pop(name) for name in ("poses", "most", "until") if name in given
    }
    return Limits(**given), asked


def model_of_spec(
    spec: Spec, stated: dict[str, float], rng: np.random.Generator
) -> ScanModel:
    """What a specification with a guess says. `stated`: its [noise]; robot errors that
    it leaves out are as usual. How well raw profiles show the target is looked up in a
    few simulated ones. Raises ScanError without a guess.
    """
    if spec.guess is None:
        raise ScanError(
            "a plan needs [guess]: roughly where the sensor (mount) and the target are"
        )
    if not spec.noise.profile_mm:
        raise ScanError("profile_mm is 0 in [noise]; a plan needs the scanner's noise")
    measured = spec.measured or TARGETS[spec.kind].tables[-1]
    prior, profile_mm = prior_from(stated), spec.noise.profile_mm
    if (
        measured == "arcs"
    ):  # errors of centre and radius, as those of three points a third of a turn apart
        profile_mm = np.sqrt(2) * profile_mm
    model = ScanModel(
        **vars(spec.guess.setup(spec.kind, sizes_of(spec))),
        scanner=spec.scanner,
        noise=replace(
            prior.scales, profile_mm=profile_mm, steering_mm=spec.noise.steering_mm
        ),
        systematic=prior.systematic,
        to_hand=spec.mount == "eye-to-hand",
        measured=measured,
        guess=spec.guess,
    )
    return with_features(model, spec, rng) if measured == "profiles" else model


def with_features(model: ScanModel, spec: Spec, rng: np.random.Generator) -> ScanModel:
    """The model with as much noise as features of its raw profiles have, in a few
    simulated ones. Raises ScanError where these do not show the target.
    """
    R, T = draw(model, Limits(), 24, rng)
    profiles = raw_profiles(model, model.planes(R, T), spec, rng)
    scan = Scan(
        spec.kind,
        ("",) * len(T),
        R,
        T,
        "profiles",
        tuple(profiles),
        model.sizes,
        title="simulated profiles",
    )
    seen = observe(scan, 1)
    observed = as_observations(scan, seen, seen.typical_mm)
    return replace(
        model,
        noise=replace(model.noise, profile_mm=seen.typical_mm),
        **features_of(observed),
    )


def features_of(observed: Observations) -> dict:
    """What typical profiles show: the `count` of points and their `covariance`, as
    `ScanModel` has them.
    """
    count, covariance = observed.points.shape[2], observed.covariance
    if covariance is not None:
        covariance = (
            np.full(count, np.median(covariance))
            if observed.on_curve
            else covariance[0].mean(axis=0)
        )
    return {"count": count, "covariance": covariance}


def model_of_scan(
    found: Calibration,
) -> tuple[ScanModel, Limits, tuple[np.ndarray, np.ndarray]]:
    """What the one scan of a calibration says of sensor, target and robot; where the
    robot may go from there; and the poses R (P, 3, 3), T (P, 3) that it used. Raises
    ScanError where it leaves the sensor pose open or is misread.
    """
    reach_mm = 200.0  # beyond the poses of a scan, the robot is believed to reach
    s, scan, observed = found.solution, found.scans[0], found.observed[0]
    if found.status == "unobservable" or found.misread:
        said = "the scan leaves the mount open, or contradicts itself: profilecal calibrate says how"
        raise ScanError(
            f"{said}; else plan from a SPEC.toml whose [guess] states it roughly"
        )
    R, T = observed.R_flange[0][s.kept[0]], observed.T_flange[0][s.kept[0]]
    prior = prior_from(stated_noise(found.scans))
    noise = replace(
        prior.scales, profile_mm=s.noise_mm, steering_mm=s.noise.steering_mm
    )
    sizes = s.found.sizes[1:]
    # where no pose is repeated, the errors of a visit are part of those of a pose
    noise = replace(
        noise, **dict.fromkeys({*ROBOT} - {size.name for size in sizes}, 0.0)
    )
    noise = replace(
        noise, **{size.name: size.middle for size in sizes if size.from_data}
    )
    model = ScanModel(
        s.placements[0],
        nearest_rotation((R @ s.rotation).mean(axis=0)),
        s.rotation,
        s.translation,
        scanner=scanner_of(scan, observed),
        noise=noise,
        systematic=prior.systematic,
        to_hand=observed.eye_to_hand,
        measured=scan.measured,
        **features_of(observed),
    )
    flange = inverse(R, T)[1] if model.to_hand else T
    limits = Limits(
        low=tuple(flange.min(axis=0) - reach_mm),
        high=tuple(flange.max(axis=0) + reach_mm),
        extent_mm=max(20.0, off_square(model, R, T)[2].max()),
    )
    return model, limits, (R, T)


def scanner_of(scan: Scan, observed: Observations) -> Scanner:
    """A scanner that sees 10 mm farther than this one was seen to see."""
    points = (
        np.concatenate(scan.values)[:, :2]
        if scan.measured == "profiles"
        else observed.points[0].reshape(-1, 2)
    )
    points = points[np.isfinite(points).all(axis=1) & points.any(axis=1)]
    (_, near), (_, far) = points.min(axis=0) - 10, points.max(axis=0) + 10
    width = 2 * (np.abs(points[:, 0]).max() + 10)
    return Scanner(near=max(near, 1.0), far=far, near_width=width, far_width=width)


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

    def prediction_of(self, place: Path) -> tuple[Prediction, int]:
        """What the poses of a folder or a file will be worth, after those that are
        there already, as far as they have the target in view; and how many have not.
        Raises ScanError.
        """
        given = planned_poses(place, self.model.to_hand)
        R, T = joined(self.before, (given["R"], given["T"]))
        seen = self.model.in_view(R, T)
        if not seen.any():
            raise ScanError(
                f"{place}: no pose has the target in view; are sensor and target where they are guessed?"
            )
        return predict(self.model, R[seen], T[seen], self.rng), int((~seen).sum())

    def plan(self) -> Plan:
        """The poses that serve best. Raises ScanError."""
        return design(
            self.model, self.limits, self.rng, before=self.before, **self.asked
        )


def task(spec: Path, poses: int | None = None, until: tuple | None = None) -> Task:
    """From a file SPEC.toml or a scan folder; `poses` and `until` go before what it
    says. Raises ScanError.
    """
    given = {"poses": poses or 0} if poses or until else {}
    given |= {"until": until} if until else {}
    if spec.is_dir():
        scan = read_scan(spec)
        model, limits, before = model_of_scan(calibrate([scan]))
        return Task(
            model,
            limits,
            given,
            np.random.default_rng(0),
            scan,
            scan.noise,
            before=before,
        )
    entries = read_toml(spec)
    found, noise = read_spec(entries, spec), entries.get("noise", {})
    limits, asked = read_plan(entries.get("plan", {}), spec)
    rng = np.random.default_rng(found.seed)
    return Task(
        model_of_spec(found, noise, rng),
        limits,
        asked | given,
        rng,
        found,
        noise,
        entries,
    )


def write_plan(task: Task, plan: Plan, folder: Path) -> None:
    """Write a plan into a folder that exists: a scan folder without measurements; from
    a specification, one that simulates these as well, with the robot's errors that the
    prediction counts with.
    """
    model, labels = plan.model, [f"{k:03d}" for k in range(1, len(plan.T) + 1)]
    R, T = inverse(plan.R, plan.T) if model.to_hand else (plan.R, plan.T)
    write_table(
        folder / "poses.csv", poses_columns(labels, R, T, task.source.convention)
    )
    target = {"kind": model.target.kind} | dict(
        zip(model.target.lengths, model.sizes, strict=True)
    )
    header = {
        "title": task.source.title or f"planned {model.target.kind}",
        "units": "mm",
        "mount": task.source.mount,
    }
    files = {"scan.toml": header | {"target": target, "noise": task.noise}}
    if task.entries:
        noise = task.noise | {name: getattr(model.noise, name) for name in ROBOT}
        files["simulate.toml"] = task.entries | {
            "plan": {},
            "poses": "poses.csv",
            "noise": noise,
        }
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
    return [
        f"noise          {n.profile_mm:.2g} mm of a feature's coordinates",
        f"robot errors   {robot}",
    ]


def predicted(found: Prediction, model: ScanModel, unseen: int = 0) -> list[str]:
    """A prediction in lines; `unseen`: how many poses do not have the target in view."""
    sd, direction = found.spectrum.sd[0], found.spectrum.directions[0]
    weakest = name_direction(
        direction, model.R_sensor, "base" if model.to_hand else "flange"
    )
    lines = [
        f"status         {found.spectrum.status}, predicted for {found.poses} poses",
        f"one sd         {deviations(found.covariance)} about the sensor's x, y, z",
        f"worst          {found.mm:.2g} mm and {found.deg:.2g}° in any direction",
        f"weakest        {weakest}, {size_direction(sd, direction) if sd < 10 else 'open'}",
    ]
    if found.between:
        (mm, deg), (most_mm, most_deg) = found.between
        between = f"{mm:.2g} to {most_mm:.2g} mm and {deg:.2g} to {most_deg:.2g}°"
        lines.insert(
            3, f"               {between} in {GUESSES} draws of how wrong the guess is"
        )
    if unseen:
        lines.append(
            f"note           {unseen} other poses do not have the target in view, where it is guessed to be"
        )
    if found.poses < 15:  # which tell the size of the errors to about 15 %
        lines.append(
            "note           few poses: what calibrate states will scatter widely"
        )
    return lines


def to_text(plan: Plan, asked: dict) -> str:
    """A plan in lines."""
    (mm, deg), found = plan.until, plan.predicted
    lines = [*believed(plan.model), *predicted(found, plan.model)]
    if not asked.get("poses") and (found.mm > mm or found.deg > deg):
        lines.append(
            f"note           {len(plan.T)} poses are not enough for {mm:g} mm and {deg:g}°"
        )
    return "\n".join(lines)


def next_poses(found: Calibration, folder: Path, rng: np.random.Generator) -> str:
    """Which poses would help an answer that is weak, in a sentence; "" where nothing
    would.
    """
    if len(found.scans) > 1:
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
