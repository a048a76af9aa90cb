"""Lack of pressure to accelerate and to brake, against the thrust of slower motions."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mhsb_model.holding import MAX_HELD_SPEED
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


@given(
    rows_of(st.floats(-0.012, 0.012)),
    rows_of(st.floats(0.0, 6000.0)),
    rows_of(st.floats(0.0, 6000.0)),
)
def test_a_load_that_drives_the_motion_is_braked_with_less_than_its_relief_valve_allows(
    machine, speed, force, inertia
):
    """The piston's balance, with the tank's pressure in the chamber that fills."""
    tank, reliefs = machine.config.hydraulics.tank_pressure, machine.chamber_reliefs
    areas = np.array([joint.areas for joint in machine.config.joints])
    filling = np.where(speed > 0.0, *areas.T)
    emptying = np.where(speed > 0.0, *areas.T[::-1])
    held = np.abs(speed) <= MAX_HELD_SPEED
    modes = np.full((ROWS, 3), Mode.N, dtype=np.uint8)

    def share_of(load):
        return np.where(held, 0.0, (filling * tank + load) / emptying / (0.85 * reliefs)).max()

    driving = -np.sign(speed) * (force + inertia)
    states = np.zeros((ROWS, 2)), driving, np.zeros((ROWS, 3))
    profile = MotionProfile(speed, np.zeros((ROWS, 3)), *states)
    thrust = LimitValues.from_profile(machine, profile, modes).of(THRUST_LIMIT).max()
    assert thrust == pytest.approx(share_of(force + inertia), rel=1e-9)
    parts = -np.sign(speed) * force, -np.sign(speed) * inertia
    excess = find_inertia_excess(machine.arrays, speed, *parts, modes)
    if thrust <= 1.0:
        assert excess == 1.0
    elif np.isinf(excess):
        assert share_of(force) > 1.0 - 1e-9
    else:
        assert share_of(force + inertia / excess) == pytest.approx(1.0, rel=1e-9)


def test_a_load_that_can_be_lifted_can_be_lowered_whatever_the_relief_valves_are_set_to(machine):
    boost = machine.arrays.max_boost_pressure
    weak = machine.with_values({"circuit.chamber_relief_pressure": 1.05 * boost})
    cap, rod = np.array([joint.areas for joint in machine.config.joints]).T
    force = boost * cap - machine.arrays.tank_pressure * rod  # lifted by extending
    speed = np.full((ROWS, 3), -0.01)
    states = np.zeros((ROWS, 2)), np.tile(force, (ROWS, 1)), np.zeros((ROWS, 3))
    profile = MotionProfile(speed, np.zeros((ROWS, 3)), *states)
    modes = np.full((ROWS, 3), Mode.N, dtype=np.uint8)
    thrust = LimitValues.from_profile(weak, profile, modes).of(THRUST_LIMIT)
    assert thrust == pytest.approx(1.0, rel=1e-9)
