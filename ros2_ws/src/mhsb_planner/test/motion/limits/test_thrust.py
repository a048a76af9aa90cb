"""Lack of pressure to accelerate, against the thrust of slower motions."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mhsb_model.modes import Mode
from mhsb_planner.motion.limits.thrust import THRUST_LIMIT, find_inertia_excess
from mhsb_planner.motion.motion_profile import MotionProfile
from mhsb_planner.motion.s3_limits import LimitValues

ROWS = 4


def rows_of(numbers):
    """List of as many rows of numbers as there are instants."""
    row = st.lists(numbers, min_size=3, max_size=3)
    return st.lists(row, min_size=ROWS, max_size=ROWS).map(np.array)


@given(
    rows_of(st.floats(-0.012, 0.012)),
    rows_of(st.floats(-6000, 6000)),
    rows_of(st.floats(-3000, 3000)),
    rows_of(st.sampled_from(list(Mode))),
)
def test_inertia_divided_by_its_excess_takes_just_the_pressure_that_there_is(
    machine, speed, force, inertia, modes
):
    modes, inertia = modes.astype(np.uint8), np.abs(inertia) * np.sign(speed)
    profile = MotionProfile(speed, force, np.zeros((ROWS, 2)), inertia, np.zeros((ROWS, 3)))

    def thrust_with(share):
        slower = replace(profile, inertia=share * inertia)
        return LimitValues.from_profile(machine, slower, modes).of(THRUST_LIMIT).max()

    excess = find_inertia_excess(machine.arrays, speed, force, inertia, modes)
    if thrust_with(1.0) <= 1.0:
        assert excess == 1.0
    elif np.isinf(excess):
        assert thrust_with(1e-9) > 1.0 - 1e-9
    else:
        assert thrust_with(1.0 / excess) == pytest.approx(1.0, abs=1e-9)
