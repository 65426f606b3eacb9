"""Sweeps in place of poses: straight lines, each driven there and back.

A delay between the clocks of robot and scanner shifts what is seen along the motion: on
the way back the other way. A wrong mount shifts both alike. So the way back tells one
from the other, and the error of the robot that both have in common drops out.
"""

from collections import Counter

import numpy as np
from numpy import ndarray

from profilecal.calibration.calibration import Calibration
from profilecal.geometry.log import DELAY_S, Log
from profilecal.geometry.poses import Frames
from profilecal.scan.scan import ScanError
from profilecal.simulation.sweeps import Motion, half_way
from profilecal_tool.plan.candidates import refused
from profilecal_tool.plan.design import Plan
from profilecal_tool.plan.scan_model import ScanModel, predict


def along_lines(plan: Plan, motion: Motion, rng: np.random.Generator) -> Plan:
    """A plan of lines through the poses of a plan, each driven there and back at the
    speed of a motion; its poses are where the sweeps begin and end.

    Raises ScanError where no line is possible.
    """
    model = plan.model
    R, ends, left_out = lines_through(model, plan.R, plan.T)
    if not len(R):
        raise ScanError(
            f"no straight sweep fits within the limits: {', '.join(left_out)}"
        )
    there_and_back = [0, 1, 1, 0]
    R, T = R.repeat(4, axis=0), ends[:, there_and_back].reshape(-1, 3)
    seconds = np.linalg.norm(T[1::2] - T[::2], axis=1) / motion.speed
    # so far apart that the log is cut between sweeps
    begin = 100 * seconds.max() * np.arange(len(seconds))
    log = Log(np.ravel([begin, begin + seconds], "F"), *model.in_base(R, T))
    share = (np.arange(motion.profiles) + 0.5) / motion.profiles
    times = (begin[:, None] + np.outer(seconds, share)).ravel()
    group = np.arange(len(seconds)).repeat(len(share))
    *flange, _ = log.at(times)
    seen = model.in_base(*flange)
    return Plan(
        model,
        R,
        T,
        predict(model, *seen, rng, log=log, times=times[None], group=group),
        plan.wanted_sd,
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
    found = np.full((len(T), 2, 3), np.nan)
    for share in (1, 1 / 2, 1 / 4):
        for middle in (0, 1, -1):
            ends = T + share * np.multiply.outer([middle - 1, middle + 1], half)
            begin, end = (refused(model, R, place) for place in ends)
            reasons = np.where(begin == "", end, begin)
            new = (reasons == "") & np.isnan(found[:, 0, 0])
            found[new] = ends.swapaxes(0, 1)[new]
    missing = np.isnan(found[:, 0, 0])
    left_out = [
        f"{count} line{'s' * (count > 1)} whose ends {reason}"
        for reason, count in Counter(reasons[missing]).most_common()
    ]
    return R[~missing], found[~missing], left_out


def way_back(found: Calibration) -> Frames | None:
    """Where the sweeps of a calibration's one scan end and begin, flange poses (2 n, 3,
    3), (2 n, 3) in the base, two of each, if it leaves the delay open: driven
    backwards, they tell it.
    """
    (scan,), solution = found.scans, found.solution_or_none
    if scan.log is None or solution is None or found.status == "ok":
        return None
    if solution.delay_sd_s < DELAY_S / 2:
        return None
    names = np.array(scan.sweeps)
    rows: list[int] = []
    for name in dict.fromkeys(names[scan.moving]):
        own = np.flatnonzero(names == name)
        rows += [own[np.argmax(scan.times[own])], own[np.argmin(scan.times[own])]]
    return scan.R_base_flange[rows], scan.p_base_flange[rows]
