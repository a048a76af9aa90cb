"""Usage of pumps and valves, and the speed limit of a piston, against their formulas."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mhsb_model.hydraulics import compute_required_pressure, get_shared_hydraulics, needs_boost
from mhsb_model.modes import Mode
from mhsb_planner.motion.limits import usage as usage_limit
from mhsb_planner.motion.limits.usage import USAGE_LIMIT
from mhsb_planner.motion.motion_profile import MotionProfile
from mhsb_planner.motion.s3_limits import LimitValues

# The product of a subnormal force and a speed may be 0, so that the force counts as none.
FORCES = st.floats(-4000, 4500, allow_subnormal=False)
MODES = st.sampled_from(list(Mode))


def speed_limit(machine, j, force, direction, mode):
    m = machine.arrays
    modules = m.modules_per_mode[mode]
    own = m.valve_coefficient[j], m.cap_area[j], m.rod_area[j]
    return usage_limit.compute_speed_limit(
        get_shared_hydraulics(m), *own, force, direction, modules
    )


def instant(speed, force, modes):
    """Profile of one instant, and its modes."""
    profile = MotionProfile(
        speed[None], force[None], np.array([[0.6, 0.0]]), np.zeros((1, 3)), np.zeros((1, 3))
    )
    return profile, np.array(modes, dtype=np.uint8)[None]


def usage(machine, speed, force, modes):
    """Usage at one instant."""
    return LimitValues.from_profile(machine, *instant(speed, force, modes)).of(USAGE_LIMIT)[0]


@given(FORCES, st.sampled_from([-1.0, 1.0]), st.floats(1e-5, 2e-4), st.floats(5e5, 1e7))
def test_in_n_a_valve_of_its_own_bounds_its_piston_by_the_closed_form(
    machine, force, direction, flow, drop
):
    """v = K √((A p − a p_T − F)/(A³ + a³)), K = Q/√Δp; with the load also K √P_S/A, the filling."""
    own = {"rated_flow": flow, "rated_pressure_drop_per_land": drop}
    arm = machine.with_values({"joints.1.actuator": own})
    m, oil = machine.arrays, machine.config.hydraulics
    cap, rod = m.cap_area[1], m.rod_area[1]
    inlet, outlet = (cap, rod) if direction > 0 else (rod, cap)
    against = force * direction > 0
    supply = oil.main_pump.pressure - (oil.boost_margin if against else 0.0)
    drive = inlet * supply - outlet * oil.tank_pressure - direction * force
    speed = flow / np.sqrt(drop) * np.sqrt(max(drive, 0.0) / (cap**3 + rod**3))
    if not against:
        speed = min(speed, flow / np.sqrt(drop) * np.sqrt(oil.main_pump.pressure) / inlet)
    assert speed_limit(arm, 1, force, direction, Mode.N) == pytest.approx(speed, rel=1e-9)
    usual = speed_limit(machine, 0, force, direction, Mode.N)
    assert speed_limit(arm, 0, force, direction, Mode.N) == usual


@given(FORCES, st.sampled_from([-1.0, 1.0]), MODES, st.integers(0, 2))
def test_against_the_load_the_speed_limit_is_where_the_pressure_is_used_up(
    machine, force, direction, mode, j
):
    m = machine.arrays
    limit = speed_limit(machine, j, force, direction, mode)
    if force * direction <= 0:
        return
    given_pressure = m.supply_pressure if mode == Mode.N else m.max_boost_pressure
    inlet = m.cap_area[j] if direction > 0 else m.rod_area[j]
    pumped = m.modules_per_mode[mode] * m.servo_pump_flow / inlet
    if limit == 0:
        assert compute_required_pressure(m, j, force, 1e-9 * direction) >= given_pressure
    elif mode != Mode.N and limit == pytest.approx(pumped):
        assert compute_required_pressure(m, j, force, limit * direction) <= given_pressure * (
            1 + 1e-9
        )
    else:
        pressure = compute_required_pressure(m, j, force, limit * direction)
        assert pressure == pytest.approx(given_pressure, rel=1e-9)


@given(FORCES, st.sampled_from([-1.0, 1.0]), st.integers(0, 2))
def test_in_normal_mode_the_speed_limit_is_where_boost_begins_to_be_needed(
    machine, force, direction, j
):
    m = machine.arrays
    limit = speed_limit(machine, j, force, direction, Mode.N)
    if force * direction > 0 and limit > 0:
        assert not needs_boost(m, j, force, direction * limit * 0.999)
        assert needs_boost(m, j, force, direction * limit * 1.001)


@given(
    st.lists(st.floats(-0.03, 0.03), min_size=3, max_size=3),
    st.lists(st.floats(-2000, 1500), min_size=3, max_size=3),
    st.lists(MODES, min_size=3, max_size=3),
)
def test_slowing_a_motion_by_its_usage_brings_it_within_the_limits(machine, speed, force, modes):
    speed, force = np.array(speed), np.array(force)
    share = usage(machine, speed, force, modes)
    if np.isfinite(share) and share > 0:
        assert usage(machine, speed / max(share, 1.0), force, modes) <= 1 + 1e-9


def test_usage_counts_the_flow_of_all_actuators_against_the_main_pump(machine):
    m = machine.arrays
    speed = np.array([0.012, -0.012, 0.012])
    inlet = np.array([m.cap_area[0], m.rod_area[1], m.cap_area[2]])
    expected = 0.012 * inlet.sum() / (m.main_pump_flow - 3 * m.leakage_flow)
    assert usage(machine, speed, np.zeros(3), np.zeros(3, np.uint8)) == pytest.approx(expected)


def test_a_boosted_valve_leaks_by_its_own_pressure_and_on_the_rail_by_that_of_the_heaviest(machine):
    m = machine.arrays._replace(main_pump_flow=1.3e-5)  # so that it is what limits
    machine = replace(machine, arrays=m)
    speed, force = np.array([0.003, 0.003, -0.003]), np.array([3500.0, 2500.0, 1000.0])
    own = [
        max(compute_required_pressure(m, j, force[j], v) for v in (0.0, speed[j])) for j in range(3)
    ]
    assert own[0] > own[1] > own[2] < m.supply_pressure
    stroke = 0.003 * (m.cap_area[0] + m.cap_area[1] + m.rod_area[2])

    def share(*lines):
        rated = m.supply_pressure - m.tank_pressure
        leakage = m.leakage_flow * np.sqrt((np.array(lines) - m.tank_pressure) / rated).sum()
        return stroke / (m.main_pump_flow - leakage)

    normal = m.supply_pressure
    assert usage(machine, speed, force, (1, 1, 0)) == pytest.approx(share(own[0], own[1], normal))
    assert usage(machine, speed, force, (2, 2, 0)) == pytest.approx(share(own[0], own[0], normal))
    assert usage(machine, speed, force, (1, 1, 2)) == pytest.approx(share(own[0], own[1], normal))


def test_a_decoupled_actuator_has_the_flow_of_one_servo_pump_and_a_shared_one_that_of_two(machine):
    force = machine.arrays.cap_area[0] * 5e6
    assert speed_limit(machine, 0, force, 1.0, Mode.DB) == pytest.approx(8.2e-3, abs=2e-5)
    assert speed_limit(machine, 0, -900.0, -1.0, Mode.DB) == pytest.approx(10.7e-3, abs=5e-5)
    assert speed_limit(machine, 0, force, 1.0, Mode.SB) == pytest.approx(16.4e-3, abs=4e-5)
