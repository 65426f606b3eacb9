"""Sweeps in place of poses: straight lines, each driven there and back.

A delay between the clocks of robot and scanner shifts what is seen along the motion: on
the way back the other way. A wrong mount shifts both alike. So the way back tells one
from the other, and the error of the robot that both have in common drops out.
"""

from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy import ndarray

from profilecal.calibration.calibration import Calibration
from profilecal.geometry.log import DELAY_S
from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import inverse
from profilecal.scan.folder import poses_columns
from profilecal.scan.scan import Scan, ScanError
from profilecal.scan.tables import write_table
from profilecal.simulation.sweeps import Motion, drive, half_way
from profilecal_tool.plan.candidates import refused
from profilecal_tool.plan.design import Plan
from profilecal_tool.plan.scan_model import ScanModel, predict
from profilecal_tool.plan.specification import straight_sweeps

TABLE = "sweeps.csv"  # of a plan: where each sweep begins, and where it ends
WHY = "driven there and back: a delay shifts both ways apart, a wrong mount does not"


def along_lines(plan: Plan, motion: Motion, rng: np.random.Generator) -> Plan:
    """A plan of lines through the poses of a plan, each driven there and back at the
    speed of a motion; its poses are where the sweeps begin and end.

    Raises ScanError where no line is possible.
    """
    model = plan.model
    R, T, left_out = lines_through(model, plan.R, plan.T)
    if not len(T):
        raise ScanError(
            f"no straight sweep fits within the limits: {', '.join(left_out)}"
        )
    there_and_back = [0, 1, 1, 0]
    R, T = R.repeat(4, axis=0), T[:, there_and_back].reshape(-1, 3)
    exact = Motion(profiles=motion.profiles, delay_ms=0.0)
    poses, flange = drive(
        model,
        exact,
        Noise(),
        np.random.default_rng(0),
        spread_deg=0.0,
        to_hand=model.to_hand,
        planned=straight_sweeps(model, R, T, motion.speed),
    )
    seen_from = inverse(*flange) if model.to_hand else flange
    in_motion = {"log": poses["log"], "times": poses["times"][None]}
    group = np.unique(poses["sweeps"], return_inverse=True)[1]
    predicted = predict(model, *seen_from, rng, group=group, **in_motion)
    return replace(
        plan,
        R=R,
        T=T,
        predicted=predicted,
        enough=0,
        speed=motion.speed,
        left_out=left_out,
    )


def lines_through(
    model: ScanModel, R: ndarray, T: ndarray
) -> tuple[ndarray, ndarray, list[str]]:
    """The longest possible lines across the target through flange poses (P, 3, 3), (P,
    3): orientations (k, 3, 3) and both ends (k, 2, 3), k <= P; and why there are no
    others, the most frequent reason first.
    """
    half = model.planes(R, T)[0] @ half_way(model)
    found: dict[int, ndarray] = {}
    for share in (1, 1 / 2, 1 / 4):
        for middle in (0, 1, -1):
            ends = T + share * np.multiply.outer([middle - 1, middle + 1], half)
            why = [refused(model, R, end) for end in ends]
            reasons = np.maximum(*why)
            for k in np.flatnonzero(reasons == ""):
                found.setdefault(int(k), ends[:, k])
    chosen = sorted(found)
    missing = Counter(np.delete(reasons, chosen)).most_common()
    left_out = [
        f"{count} line{'s' * (count > 1)} whose ends {reason}"
        for reason, count in missing
    ]
    ends = np.array([found[k] for k in chosen]).reshape(-1, 2, 3)
    return R[chosen], ends, left_out


def write_sweeps(path: Path, R: ndarray, p: ndarray, convention: str) -> None:
    """Write where sweeps begin and end, flange poses (2 n, 3, 3), (2 n, 3) in the base,
    two of each.
    """
    labels = [f"s{k // 2 + 1} {('begin', 'end')[k % 2]}" for k in range(len(p))]
    write_table(path, poses_columns(labels, R, p, convention))


@dataclass(frozen=True)
class WayBack:
    """The sweeps of a scan backwards, which tell a delay that they leave open."""

    scan: Scan
    R: ndarray  # (2 n, 3, 3) where each begins and ends
    p: ndarray  # (2 n, 3) mm

    @classmethod
    def of(cls, found: Calibration) -> "WayBack | None":
        """Those of the one scan of a calibration, if it leaves the delay open."""
        (scan,) = found.scans
        solution = found.solution_or_none
        if scan.log is None or solution is None or found.status == "ok":
            return None
        if solution.delay_sd_s < DELAY_S / 2:
            return None
        names = np.array(scan.sweeps)
        rows: list[int] = []
        for name in dict.fromkeys(names[scan.moving]):
            own = np.flatnonzero(names == name)
            rows += [own[np.argmax(scan.times[own])], own[np.argmin(scan.times[own])]]
        return cls(scan, scan.R_base_flange[rows], scan.p_base_flange[rows])

    @property
    def lines(self) -> list[str]:
        """What it is, in words."""
        return [
            "delay          open: the sweeps of this scan hide it",
            f"sweeps         {len(self.p) // 2}, those of the scan backwards, so that "
            f"each is {WHY}",
        ]
