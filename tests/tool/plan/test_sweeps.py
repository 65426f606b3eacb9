"""Plans of sweeps, as a user drives them."""

import re

import numpy as np
import pytest
from command import run
from planned import TO_HAND, spec_in, worst

import profilecal as pc
from profilecal_tool.plan.scan_model import largest_sd
from profilecal_tool.plan.task import read_task

ROBOT = "position_mm = 0.05\norientation_deg = 0.02\n"
MOTION = "[motion]\ndelay_ms = -80.0\nsweeps = 16\nprofiles = 12\n"
IN_MOTION = (ROBOT, MOTION), ("500\nposes = 8", "200")


@pytest.mark.parametrize(
    "change", [TO_HAND, [('"edge"', '"ball"')]], ids=["to hand", "ball"]
)
def test_planned_sweeps_give_what_is_predicted(tmp_path, change):
    spec = spec_in(tmp_path, *IN_MOTION, *change)
    said = run("plan", spec, tmp_path / "plan").stdout
    count = int(re.search(r"sweeps +(\d+), driven there and back", said)[1])
    assert 8 <= count <= 16  # lines that leave the limits are left out
    given = run("plan", spec, "--of", tmp_path / "plan/sweeps.csv").output
    assert "sweeps.csv has sweeps; expected poses at rest" in given
    run("simulate", tmp_path / "plan" / "simulate.toml", tmp_path / "scan")
    scan = pc.read_scan(tmp_path / "scan")
    found = pc.calibrate(scan)
    assert found.status == "ok"
    solution = found.solution
    assert abs(-80 - 1e3 * solution.delay_s) < 4e3 * solution.delay_sd_s < 4
    ratio = largest_sd(found.covariance_mm_deg) / worst(said)
    assert np.abs(np.log(ratio)).max() < np.log(1.5)


def test_sweeps_are_as_many_as_it_takes_and_limits_cost_some(tmp_path):
    spec = spec_in(tmp_path, *IN_MOTION)
    plans = [read_task(spec, until=wish).plan() for wish in ((0.6, 0.4), (0.2, 0.15))]
    assert not any(plan.falls_short for plan in plans)
    assert len(plans[0].T) < len(plans[1].T)
    hopeless = "[plan]\nmost = 6\nuntil = [0.01, 0.01]\nlow = [880, -60, 380]"
    spec_in(tmp_path, *IN_MOTION, ("[plan]", hopeless))
    plan = read_task(spec).plan()
    lines = 6 - sum(int(why.split()[0]) for why in plan.left_out)
    assert 4 * lines == len(plan.T) < 24
    flat = "low = [880, -60, 419]\nhigh = [2000, 60, 420]"
    spec_in(tmp_path, *IN_MOTION, ("candidates = 200", flat))
    said = run("plan", spec, "--poses", "3").output
    assert "no straight sweep fits within the limits" in said
    assert "are outside the box" in said


def test_poses_that_are_no_ends_of_sweeps_are_refused(tmp_path):
    spec = spec_in(tmp_path, *IN_MOTION, ("seed", 'poses = "p.csv"\nseed'))
    lines = [f"{k},{900 + 5 * k},50,400,180,0,0" for k in range(3)]
    (tmp_path / "p.csv").write_text("\n".join(["pose,x,y,z,w,p,r", *lines]))
    said = run("simulate", spec, tmp_path / "scan").output
    assert "p.csv: expected two rows for each sweep" in said
