"""What observations must be."""

from dataclasses import replace

import numpy as np
import pytest
from many_scenes import SIGMA

from profilecal.geometry.checks import UnobservableError
from profilecal.geometry.noise import Noise
from profilecal.joint.solve import solve
from profilecal.simulate.scene import random_scene


def test_covariances_of_another_shape_are_refused():
    rng = np.random.default_rng(16)
    edge, point = (random_scene(kind, rng).observations for kind in ("edge", "point"))
    with pytest.raises(ValueError, match=r"covariance has shape \(250, 3, 3\); expected \(..., 250, 2, 2\)"):
        replace(edge, covariance=np.ones((250, 3, 3)))
    with pytest.raises(ValueError, match="a point has no covariance of its own"):
        replace(point, covariance=np.ones((20, 2, 2)))


def test_guards_say_what_is_wrong():
    rng = np.random.default_rng(22)
    good = random_scene("ball", rng, groups=2, positions=2, count=3).observations
    with pytest.raises(ValueError, match="kind is 'cone'; expected one of edge"):
        replace(good, kind="cone")
    with pytest.raises(ValueError, match="the ball's radius is None; expected a length in mm"):
        replace(good, sizes=())
    with pytest.raises(
        ValueError, match=r"points of the disk have shape \(1, 4, 3, 2\); expected \(..., poses, 2, 2\)"
    ):
        replace(good, kind="disk")
    with pytest.raises(ValueError, match=r"T_flange has shape \(1, 3, 3\)"):
        replace(good, T_flange=good.T_flange[:, :3])
    with pytest.raises(ValueError, match="R_flange holds a value that is not finite"):
        replace(good, R_flange=good.R_flange * np.nan)
    with pytest.raises(ValueError, match=r"group has shape \(1,\); expected \(4,\)"):
        replace(good, group=np.zeros(1))
    with pytest.raises(ValueError, match="no observations given"):
        solve([])
    with pytest.raises(ValueError, match="profile_mm is -1"):
        solve([good], Noise(-1))
    few = random_scene("point", rng, groups=3).observations
    with pytest.raises(UnobservableError, match="9 measured coordinates cannot determine 9 unknowns; add poses"):
        solve([few], Noise(SIGMA))
