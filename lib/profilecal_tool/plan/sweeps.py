"""Sweeps in place of poses: straight lines, each driven there and back.

A delay between the clocks of robot and scanner shifts what is seen along the motion: on
the way back the other way. A wrong mount shifts both alike. So the way back tells one
from the other, and the error of the robot that both have in common drops out.
"""

from collections import Counter

import numpy as np
from numpy import ndarray

from profilecal.geometry.noise import Noise
from profilecal.scan.scan import ScanError
from profilecal.simulation.sweeps import Motion, drive, half_way, straight
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
    said, flange = drive(
        model,
        # few rows of a log tell straight lines
        Motion(profiles=motion.profiles, delay_ms=0.0, log_hz=2.0),
        Noise(),
        rng,
        spread_deg=0.0,
        to_hand=model.to_hand,
        planned=straight(model, R, T, motion.speed),
    )
    in_motion = {
        "log": said["log"],
        "times": said["times"][None],
        "group": np.unique(said["sweeps"], return_inverse=True)[1],
    }
    return Plan(
        model,
        R,
        T,
        predict(model, *model.in_base(*flange), rng, **in_motion),
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
