"""A plan as a folder ready to run: poses for the robot, a table, a page, a specification that simulates it."""

import json
import string
from html import escape
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pandas as pd

from profilecal.geometry.poses import inverse
from profilecal.plan.candidates import turned, worst_clearance
from profilecal.plan.plan import Plan
from profilecal.scan.files import new_folder
from profilecal.scan.folder import poses_columns
from profilecal.scan.toml import toml_text
from profilecal.simulate.spec import names_of


def robot_poses(plan: Plan) -> tuple[np.ndarray, np.ndarray]:
    """Where the robot takes its flange, (P, 3, 3), (P, 3) mm in the base frame."""
    return inverse(plan.R, plan.T) if plan.setup.to_hand else (plan.R, plan.T)


def labels(plan: Plan) -> list[str]:
    """Of the poses: numbers, with as many digits each."""
    digits = len(str(len(plan.T)))
    return [f"{k + 1:0{digits}d}" for k in range(len(plan.T))]


def details_table(plan: Plan) -> pd.DataFrame:
    """What each pose does, in the order of the way."""
    setup, (_, T) = plan.setup, robot_poses(plan)
    points = setup.seen(setup.target, setup.planes(plan.R, plan.T), 5)
    tilt, spin = turned(setup, plan.R)
    return pd.DataFrame(
        {
            "pose": labels(plan),
            "rank": plan.rank,
            "way_mm": np.r_[0, np.linalg.norm(np.diff(T, axis=0), axis=1)],
            "tilt_deg": tilt,
            "spin_deg": spin,
            "depth_mm": points[..., 1].mean(axis=1),
            "aside_mm": points[..., 0].mean(axis=1),
            "clearance_mm": worst_clearance(setup, plan.R, plan.T),
        }
    ).round(2)


def way_mm(plan: Plan) -> float:
    """How far the flange travels."""
    return float(np.linalg.norm(np.diff(robot_poses(plan)[1], axis=0), axis=1).sum())


def write_plans(plans: list[Plan], folder, *, convention: str, stated: dict, entries: dict | None = None, title=""):
    """Write plans that belong together into a new folder; of several targets, each into a folder there that is named
    after it. Returns the plans by their folders' names, "" for a single one.

    `stated`: the [noise] that goes into scan.toml; `entries` of a specification with [guess], for simulate.toml. Raises
    ScanError where the folder is taken.
    """
    kinds = [plan.setup.target.kind for plan in plans]
    named = {name: plan for name, plan in zip(names_of(kinds), plans, strict=True) if len(plan.T)}
    with new_folder(Path(folder)) as partial:
        for name, plan in named.items():
            (partial / name).mkdir(exist_ok=True)
            write_plan(plan, partial / name, convention, stated, title)
        if entries is not None:
            kept = {entry: value for entry, value in entries.items() if entry != "plan"}
            if several := kept.get("targets"):
                drive = zip(names_of(kinds), several, strict=True)
                kept["targets"] = [of | {"poses": f"{name}/poses.csv"} for name, of in drive if name in named]
            else:
                kept["poses"] = "poses.csv"
            (partial / "simulate.toml").write_text(toml_text(kept), encoding="utf-8")
    return named


def write_plan(plan: Plan, folder: Path, convention: str, stated: dict, title: str) -> None:
    """Write one of them into a folder that exists."""
    setup = plan.setup
    target = {"kind": setup.target.kind} | dict(zip(setup.target.lengths, setup.sizes, strict=True))
    mount = "eye-to-hand" if setup.to_hand else "eye-in-hand"
    header = {"title": title, "units": "mm", "mount": mount, "target": target, "noise": stated}
    poses = pd.DataFrame(poses_columns(labels(plan), *robot_poses(plan), convention))
    poses.to_csv(folder / "poses.csv", index=False, float_format="%.12g")
    (folder / "scan.toml").write_text(toml_text(header), encoding="utf-8")
    details_table(plan).to_csv(folder / "plan.csv", index=False)
    curve = pd.DataFrame(plan.curve, columns=["poses", "mm", "deg"])
    curve.to_csv(folder / "curve.csv", index=False, float_format="%.4g")
    (folder / "plan.html").write_text(page(plan, poses), encoding="utf-8")


def page(plan: Plan, poses: pd.DataFrame) -> str:
    """A page that shows the plan in space, needs nothing else and fetches nothing."""
    setup, limits = plan.setup, plan.wishes.limits
    R, T = robot_poses(plan)
    box = [limits.low, limits.high] if np.isfinite([limits.low, limits.high]).all() else None
    data = {
        "to_hand": setup.to_hand,
        "R": R.reshape(-1, 9).round(5).tolist(),
        "T": T.round(2).tolist(),
        "scan": fan(plan).round(2).tolist(),
        "target": [line.round(2).tolist() for line in target_lines(plan)],
        "box": box,
        "avoid": limits.avoid,
        "rows": poses.round(3).join(details_table(plan).drop(columns="pose")).astype(str).to_dict("list"),
    }
    p = plan.predicted
    whole = "" if p.poses == len(T) else f" with the {p.poses - len(T)} others"
    said = f"{len(T)} poses, predicted{whole}: {p.mm:.2g} mm, {p.deg:.2g}° (one sd, worst direction)"
    said += f"; way {way_mm(plan):.0f} mm"
    text = json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")
    frame = string.Template(Path(__file__).with_name("page.html").read_text(encoding="utf-8"))
    made = f"profilecal {version('profilecal')}"
    return frame.substitute(title=escape(f"Plan: {setup.target.kind}"), said=escape(said), data=text, made=made)


def fan(plan: Plan) -> np.ndarray:
    """The sensor's origin and the corners of its field of view, (5, 3), mm, in the frame that it is fixed to."""
    scanner = plan.setup.scanner
    depths = np.array([scanner.near, scanner.far, scanner.far, scanner.near])
    x = scanner.half_width(depths) * [-1, -1, 1, 1]
    corners = np.vstack([np.zeros(3), np.stack([x, 0 * x, depths], axis=1)])
    return corners @ plan.setup.R_sensor.T + plan.setup.T_sensor


def target_lines(plan: Plan) -> list[np.ndarray]:
    """Polylines (n, 3) of the target, mm, in the frame that it is fixed to."""
    setup = plan.setup
    R_view, T_view = setup.planes(plan.R, plan.T)
    points = setup.seen(setup.target, (R_view, T_view), 5)
    seen = points[..., :1] * R_view[:, None, :, 0] + points[..., 1:] * R_view[:, None, :, 2] + T_view[:, None]
    return [np.asarray(line)[:: max(1, len(line) // 40)] for line in setup.target.lines(seen.reshape(-1, 3))]
