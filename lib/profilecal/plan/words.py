"""What `profilecal plan` prints for people."""

from profilecal.calibrate.summary import deviations
from profilecal.plan.folder import way_mm
from profilecal.plan.plan import Plan
from profilecal.plan.setup import GUESSES, Prediction, Setup
from profilecal.simulate.spec import names_of

FIGURES = 12  # of a curve, in print
FEW_SPARE = 20  # measurements beyond the unknowns: they tell the size of the errors to about 15 %
OPEN_MM, OPEN_DEG = 100.0, 50.0  # nothing to print


def believed(setup: Setup) -> list[str]:
    """What a prediction counts with, in lines."""
    n = setup.noise
    robot = (
        f"{n.position_mm:.2g} mm and {n.orientation_deg:.2g}° at each pose, {n.group_position_mm:.2g} mm and "
        f"{n.group_orientation_deg:.2g}° at each orientation, {n.repeatability_mm:.2g} mm and "
        f"{n.repeatability_deg:.2g}° at each visit"
    )
    return [f"noise          {n.profile_mm:.2g} mm of a feature's coordinates", f"robot errors   {robot}"]


def predicted(found: Prediction) -> list[str]:
    """A prediction in lines."""
    lines = [
        f"status         {found.spectrum.status}, predicted for {found.poses} poses",
        f"one sd         {deviations(found.covariance)} about the sensor's x, y, z",
        f"worst          {found.mm:.2g} mm and {found.deg:.2g}° in any direction",
        f"weakest        {found.weakest}",
    ]
    if found.spare < FEW_SPARE:
        few = f"few poses: only {found.spare} measurements more than unknowns"
        lines.append(f"note           {few}, so that what calibrate states will scatter widely")
    if found.between:
        (mm, most_mm), (deg, most_deg) = found.between
        between = f"{mm:.2g} to {most_mm:.2g} mm and {deg:.2g} to {most_deg:.2g}°"
        lines.insert(3, f"               {between} in {GUESSES} draws of how wrong the guess is")
    return lines


def to_text(plans: list[Plan]) -> str:
    """Plans that belong together in lines."""
    plan, poses, way = plans[0], sum(len(plan.T) for plan in plans), sum(way_mm(plan) for plan in plans)
    (mm, deg), curve = plan.wishes.until, plan.curve
    few = curve[:: -(-len(curve) // FIGURES)]
    few += [] if few[-1] == curve[-1] else [curve[-1]]
    until = f"{plan.enough} poses" if plan.enough else f"more than {poses} poses"
    names = names_of([plan.setup.target.kind for plan in plans])
    split = ", ".join(f"{len(plan.T)} over {name}" for name, plan in zip(names, plans, strict=True))
    return "\n".join(
        [
            *believed(plan.setup),
            *predicted(plan.predicted),
            *([f"poses          {split}"] if len(plans) > 1 else []),
            f"until          {until} for {mm:g} mm and {deg:g}°",
            *(f"{n:4d} poses     {m:.2g} mm  {d:.2g}°" for n, m, d in few if m < OPEN_MM and d < OPEN_DEG),
            f"way            {way:.0f} mm",
        ]
    )
