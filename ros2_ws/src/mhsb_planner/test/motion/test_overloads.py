"""Rests under loads that no boost carries."""

import numpy as np
import pytest

from mhsb_model.hydraulics import compute_required_pressure, compute_sinking_speed
from mhsb_model.trajectory import standstill
from mhsb_planner.motion.motion_profile import MotionProfile
from mhsb_planner.motion.overloads import find_overloads
from mhsb_planner.motion.s3_trajectory import fit_braking
from mhsb_planner.motion.s4_mode_schedule import StartModes

TIME = np.array([0.0, 1.0, 2.0, 3.0])


def profile(force, speed):
    """Of actuator 1; the others stand still without a load."""
    rows = np.zeros((2, len(TIME), 3))
    rows[0, :, 0], rows[1, :, 0] = force, speed
    return MotionProfile(
        rows[1], rows[0], np.zeros((len(TIME), 2)), np.zeros_like(rows[0]), np.zeros_like(rows[0])
    )


@pytest.fixture
def heavy(machine):
    """Force on actuator 1 that takes a little more than the highest boost to hold [N]."""
    m = machine.arrays
    force = 1.02 * m.max_boost_pressure * m.cap_area[0]
    assert compute_required_pressure(m, 0, force, 0.0) > m.max_boost_pressure
    return force


def test_only_rests_beyond_the_highest_boost_are_named(machine, heavy):
    light = 0.5 * heavy
    assert find_overloads(machine, TIME, profile(light, 0.0)) == ()
    assert find_overloads(machine, TIME, profile(heavy, -0.01)) == ()
    (found,) = find_overloads(machine, TIME, profile([light, heavy, heavy, light], 0.0))
    assert (found.actuator, found.duration, found.at_end) == ("actuator_1", 2.0, False)
    assert found.pressure == pytest.approx(compute_required_pressure(machine.arrays, 0, heavy, 0.0))
    assert "closed valve" in str(found)


def test_a_load_that_sinks_through_a_leaking_valve_is_said_to_sink(machine, heavy):
    still = profile(heavy, 0.0)
    assert "sinking" not in str(find_overloads(machine, TIME, still)[0])
    leaky = machine.with_values({"hydraulics.valve.land_leakage": 0.1})
    (found,) = find_overloads(leaky, TIME, still)
    speed = compute_sinking_speed(leaky.arrays, 0, heavy, leaky.arrays.max_boost_pressure)
    assert speed < 0.0
    assert found.sinking_speed == -speed
    assert str(found).endswith(f"holds it, sinking by {-6e4 * speed:.3g} mm/min")
    locked = leaky.with_values({"circuit.lock_valve_opening": 0.01})
    assert "sinking" not in str(find_overloads(locked, TIME, still)[0])


def test_a_load_that_is_pulled_counts_like_one_that_is_pushed(machine):
    m = machine.arrays
    pulled = -1.02 * m.max_boost_pressure * m.rod_area[0]
    (found,) = find_overloads(machine, TIME, profile([0.0, 0.0, pulled, pulled], 0.0))
    assert found.pressure == pytest.approx(compute_required_pressure(m, 0, pulled, 0.0))
    assert found.at_end
    assert "at the goal" in str(found)


def test_a_motion_says_what_it_leaves_to_the_valves(machine):
    loaded = machine.changed(payload=40.0)
    stretched = np.array([0.3, -0.3, -0.3])
    motion = fit_braking(loaded, standstill(stretched), StartModes.create_settled([0, 0, 0]))
    assert [overload.actuator for overload in motion.overloads][:1] == ["actuator_1"]
    folded = np.array(machine.config.simulation.start_posture)
    assert (
        fit_braking(machine, standstill(folded), StartModes.create_settled([0, 0, 0])).overloads
        == ()
    )
