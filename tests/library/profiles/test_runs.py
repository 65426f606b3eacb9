"""Straight runs of a profile."""

import numpy as np

from profilecal.profiles.runs import straight_runs


def test_a_spike_that_is_on_the_line_behind_a_step_is_no_part_of_the_run():
    """What is farther away has larger x."""
    x, z = np.linspace(0, 40, 400), np.full(400, 100.0)
    x[300:] += 2
    z[300:] = 120
    z[304] = 100
    first, _ = straight_runs(np.column_stack([x, z]))
    assert first.rows[-1] == 299
