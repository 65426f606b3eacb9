"""What `profilecal plan` prints for people."""

from profilecal.calibrate.words import deviations
from profilecal.plan.folder import way_mm
from profilecal.plan.plan import Plan
from profilecal.plan.setup import Prediction, Setup

FIGURES = 12  # of a curve, in print
OPEN_MM, OPEN_DEG = 100.0, 50.0  # nothing to print


def believed(setup: Setup) -> list[str]:
    """What a prediction counts with, in lines."""
    n = setup.noise
    robot = (
        f"{n.position_mm:g} mm and {n.orientation_deg:g}° at each pose, {n.group_position_mm:g} mm and "
        f"{n.group_orientation_deg:g}° at each orientation, {n.repeatability_mm:g} mm and {n.repeatability_deg:g}° "
        "at each visit"
    )
    return [f"noise          {n.profile_mm:.2g} mm of a feature's coordinates", f"robot errors   {robot}"]


def predicted(found: Prediction) -> list[str]:
    """A prediction in lines."""
    return [
        f"status         {found.spectrum.status}, predicted for {found.poses} poses",
        f"one sd         {deviations(found.covariance)} about the sensor's x, y, z",
        f"worst          {found.mm:.2g} mm and {found.deg:.2g}° in any direction",
        f"weakest        {found.weakest}",
    ]


def to_text(plan: Plan) -> str:
    """A plan in lines."""
    (mm, deg), curve = plan.wishes.until, plan.curve
    few = curve[:: -(-len(curve) // FIGURES)]
    few += [] if few[-1] == curve[-1] else [curve[-1]]
    until = f"{plan.enough} poses" if plan.enough else f"more than {len(plan.T)} poses"
    return "\n".join(
        [
            *believed(plan.setup),
            *predicted(plan.predicted),
            f"until          {until} for {mm:g} mm and {deg:g}°",
            *(f"{n:4d} poses     {m:.2g} mm  {d:.2g}°" for n, m, d in few if m < OPEN_MM and d < OPEN_DEG),
            f"way            {way_mm(plan):.0f} mm",
        ]
    )
