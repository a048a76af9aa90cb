"""Limits of a valve-controlled cylinder, against orifice equations solved by SciPy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from mhsb_model import hydraulics

K, CAP, ROD = 1.78e-8, 490.9e-6, 377.8e-6
SUPPLY, TANK = 4e6, 1e5
forces = st.floats(-800.0, 1500.0)


def force_of_the_open_valve(v: float) -> float:
    """Cylinder force at the piston speed v through the fully open valve: orifices in series."""
    if v > 0:
        cap_pressure = SUPPLY - (v * CAP / K) ** 2
        rod_pressure = TANK + (v * ROD / K) ** 2
    else:
        rod_pressure = SUPPLY - (v * ROD / K) ** 2
        cap_pressure = TANK + (v * CAP / K) ** 2
    return cap_pressure * CAP - rod_pressure * ROD


@given(forces)
def test_extension_speed_balances_the_orifices(force):
    v = hydraulics.compute_extension_speed(K, CAP, ROD, SUPPLY, TANK, force)
    solved = brentq(lambda v: force_of_the_open_valve(v) - force, 1e-9, 1.0)
    assert v == pytest.approx(solved, rel=1e-6)


@given(forces)
def test_retraction_speed_balances_the_orifices(force):
    v = hydraulics.compute_retraction_speed(K, CAP, ROD, SUPPLY, TANK, force)
    solved = brentq(lambda v: force_of_the_open_valve(-v) - force, 1e-9, 1.0)
    assert v == pytest.approx(solved, rel=1e-6)


def test_a_load_beyond_the_supply_leaves_a_one_sided_range():
    assert hydraulics.compute_extension_speed(K, CAP, ROD, SUPPLY, TANK, 2000.0) == 0.0
    assert hydraulics.compute_retraction_speed(K, CAP, ROD, SUPPLY, TANK, 2000.0) > 0.0
    assert hydraulics.compute_retraction_speed(K, CAP, ROD, SUPPLY, TANK, -2000.0) == 0.0


@given(forces, st.floats(0.001, 0.05))
def test_load_pressure_and_valve_margin_are_the_supply_that_just_reaches_a_speed(force, v):
    for speed, limit in (
        (v, hydraulics.compute_extension_speed),
        (-v, hydraulics.compute_retraction_speed),
    ):
        supply = hydraulics.compute_pressure_without_margin(K, CAP, ROD, TANK, force, speed)
        assert limit(K, CAP, ROD, supply, TANK, force) == pytest.approx(v, rel=1e-6)


@given(st.floats(-0.05, 0.05).filter(bool))
def test_the_speed_of_a_drop_is_that_at_which_the_valve_takes_it(speed):
    drop = hydraulics.compute_valve_drop(K, CAP, ROD, speed)
    assert hydraulics.compute_speed_from_drop(K, CAP, ROD, drop, speed) == pytest.approx(abs(speed))
    assert hydraulics.compute_speed_from_drop(K, CAP, ROD, -drop, speed) == 0.0


@pytest.mark.parametrize(
    ("direction", "untanked_force", "inlet", "outlet"),
    [(1.0, -895, CAP, ROD), (-1.0, 3315, ROD, CAP)],
)
def test_inlet_empties_at_the_overrunning_load_that_the_orifices_give(
    direction, untanked_force, inlet, outlet
):
    v = K * np.sqrt(SUPPLY) / inlet
    throttled = -direction * outlet * (v * outlet / K) ** 2
    assert throttled == pytest.approx(untanked_force, abs=1)
    limit_force = throttled - direction * outlet * TANK
    for force, empties in ((limit_force * 1.01, True), (limit_force * 0.99, False)):
        assert hydraulics.cavitates(CAP, ROD, SUPPLY, TANK, force, direction) == empties


def test_boost_is_needed_only_against_the_load(machine):
    force = 2500.0
    assert hydraulics.needs_boost(machine.arrays, 0, force, 0.012)
    assert not hydraulics.needs_boost(machine.arrays, 0, force, -0.012)
    assert hydraulics.needs_boost(machine.arrays, 0, force, 0.0)
    assert not hydraulics.needs_boost(machine.arrays, 0, 500.0, 0.012)


def test_required_pressure_adds_load_valve_and_margin(machine):
    arrays = machine.arrays
    force, speed = 1000.0, 0.012
    by_hand = (force + arrays.rod_area[0] * 1e5) / arrays.cap_area[0]
    by_hand += (speed * arrays.cap_area[0] / arrays.valve_coefficient[0]) ** 2
    by_hand += (speed * arrays.rod_area[0] / arrays.valve_coefficient[0]) ** 2 * (
        arrays.rod_area[0] / arrays.cap_area[0]
    )
    by_hand += arrays.boost_margin
    assert hydraulics.compute_required_pressure(arrays, 0, force, speed) == pytest.approx(by_hand)


@given(st.floats(2e-5, 3e-4), st.floats(5e5, 1e7), st.floats(-800.0, 1500.0), st.booleans())
def test_an_own_valve_needs_the_pressure_at_which_its_orifices_balance(
    machine, flow, drop, force, extends
):
    """At the supply p_L + m(v) + margin, less the margin, both edges in series pass just v."""
    own = machine.with_values(
        {
            "joints.1.actuator.rated_flow": flow,
            "joints.1.actuator.rated_pressure_drop_per_land": drop,
        }
    ).arrays
    cap, rod, speed = own.cap_area[1], own.rod_area[1], 0.01 if extends else -0.01
    supply = hydraulics.compute_required_pressure(own, 1, force, speed) - own.boost_margin
    inlet, outlet = (cap, rod) if extends else (rod, cap)
    fed = supply - drop * (0.01 * inlet / flow) ** 2
    emptied = own.tank_pressure + drop * (0.01 * outlet / flow) ** 2
    balance = (fed * inlet - emptied * outlet) * (1 if extends else -1)
    assert balance == pytest.approx(force, rel=1e-9, abs=1e-6)
    others = hydraulics.compute_required_pressure(machine.arrays, 0, force, speed)
    assert hydraulics.compute_required_pressure(own, 0, force, speed) == others


def test_required_pressures_are_those_of_the_actuators_one_by_one(machine):
    random = np.random.default_rng(2)
    force, speed = random.uniform(-3e3, 3e3, (5, 3)), random.choice([0.0, 0.01, -0.01], (5, 3))
    found = hydraulics.compute_required_pressures(machine.arrays, force, speed)
    for (i, j), pressure in np.ndenumerate(found):
        alone = hydraulics.compute_required_pressure(machine.arrays, j, force[i, j], speed[i, j])
        assert pressure == alone
