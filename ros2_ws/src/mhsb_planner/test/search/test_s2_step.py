"""The cost of one step, against the conventions worked out in plain Python."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.lower_bounds import energy_lower_bound

from mhsb_model.machine import Machine, load_machine
from mhsb_planner.search.s2_step import compute_step_costs

MACHINE = load_machine()


def postures(machine=MACHINE):
    limits = zip(machine.arrays.joint_min, machine.arrays.joint_max, strict=True)
    return st.tuples(*(st.floats(low, high) for low, high in limits)).map(np.array)


def changed(machine, **changes):
    """The machine with entries of the hydraulics section changed, or of actuators', by path."""
    if any(path.startswith("joints.") for path in changes):
        return machine.with_values(changes)
    content = machine.config.model_dump()
    for path, value in changes.items():
        *sections, name = path.split("__")
        place = content["hydraulics"]
        for section in sections:
            place = place[section]
        place[name] = value
    return Machine.from_config(type(machine.config).model_validate(content))


VARIANTS = {
    "as it is": {},
    "low supply pressure": {"main_pump__pressure": 1.5e6},
    "high supply pressure": {"main_pump__pressure": 9e6},
    "little flow": {"main_pump__max_flow": 1.2e-5},
    "small valves": {"valve__rated_flow": 4e-6},
    "low boost pressure": {"servo_pump__max_boost_pressure": 5e6},
    "two modules": {"modules__count": 2},
    "leaking lands": {"valve__land_leakage": 0.7},
    "pumps with slip": {"servo_pump__slip_flow": 2e-6},
    "own valves and speeds": {
        "joints.0.actuator.rated_flow": 5e-5,
        "joints.1.actuator.max_piston_speed": 0.005,
        "joints.2.actuator.rated_flow": 4e-6,
        "joints.2.actuator.rated_pressure_drop_per_land": 2e6,
        "joints.2.actuator.max_piston_speed": 0.009,
    },
}


def assert_same_steps(costs, expected):
    assert set(np.flatnonzero(costs.admissible)) == set(expected)
    for p, (duration, paper, series) in expected.items():
        assert costs.duration[p] == pytest.approx(duration, rel=1e-9)
        assert costs.energy[p] == pytest.approx(paper, rel=1e-9)
        assert costs.energy_series[p] == pytest.approx(series, rel=1e-9)


@pytest.mark.parametrize("variant", VARIANTS)
def test_steps_between_any_postures_cost_what_the_book_says(machine, slow_steps, variant):
    arm = changed(machine, **VARIANTS[variant])
    rng = np.random.default_rng(3)
    low, high = arm.arrays.joint_min, arm.arrays.joint_max
    possible = 0
    for _ in range(60):
        start = rng.uniform(low, high)
        end = np.clip(start + rng.uniform(-0.3, 0.3, arm.joint_count), low, high)
        expected = slow_steps(arm, start, [end] * len(arm.patterns))
        assert_same_steps(compute_step_costs(arm, start, end), expected)
        possible += bool(expected)
    assert possible > 5


def test_joints_that_are_held_cost_what_the_book_says(machine, slow_steps):
    rng = np.random.default_rng(4)
    low, high = machine.arrays.joint_min, machine.arrays.joint_max
    for moving in range(machine.joint_count):
        for _ in range(10):
            start = rng.uniform(low, high)
            end = start.copy()
            end[moving] = rng.uniform(low[moving], high[moving])
            expected = slow_steps(machine, start, [end] * len(machine.patterns))
            assert_same_steps(compute_step_costs(machine, start, end), expected)
            for p in expected:
                boosted = machine.patterns[p] > 0
                assert not boosted[np.arange(machine.joint_count) != moving].any()


def test_boost_without_need_is_refused_where_a_pattern_fits(machine):
    down = compute_step_costs(machine, np.array([0.0, -0.5, -0.5]), np.array([-0.05, -0.55, -0.55]))
    assert list(np.flatnonzero(down.admissible)) == [0]


def test_beyond_the_highest_boost_pressure_no_pattern_lifts(machine):
    heavy = machine.changed(payload=60.0)
    up = compute_step_costs(heavy, np.array([0.0, 0.0, 0.0]), np.array([0.05, 0.0, 0.0]))
    assert not up.admissible.any()
    assert np.all(np.isnan(up.energy))


def test_standing_still_takes_nothing(machine):
    q = np.array([0.2, -0.6, -0.4])
    still = compute_step_costs(machine, q, q)
    assert list(np.flatnonzero(still.admissible)) == [0]
    assert (still.duration[0], still.energy[0], still.energy_series[0]) == (0.0, 0.0, 0.0)


@given(postures(), postures())
def test_no_step_takes_less_than_the_lower_bound(start, end):
    costs = compute_step_costs(MACHINE, start, end)
    bound = energy_lower_bound(MACHINE, start, end[None, :])
    for p in np.flatnonzero(costs.admissible):
        assert costs.energy[p] >= bound * (1 - 1e-12)
        assert costs.energy_series[p] >= bound * (1 - 1e-12)


def test_slip_costs_nothing_in_the_paper_s_reading_and_more_with_more_modules(machine):
    start, end = np.array([0.05, -0.1, -0.1]), np.array([0.07, -0.09, -0.09])
    tight = compute_step_costs(machine, start, end)
    slipping = compute_step_costs(changed(machine, servo_pump__slip_flow=2e-6), start, end)
    np.testing.assert_array_equal(slipping.energy, tight.energy)
    np.testing.assert_array_equal(slipping.duration, tight.duration)
    boosted = tight.admissible & (machine.patterns > 0).any(axis=1)
    assert boosted.any()
    assert np.all(slipping.energy_series[boosted] > 1.01 * tight.energy_series[boosted])


@given(postures(), postures())
def test_boost_is_never_cheaper_than_normal_mode_at_the_same_pace(start, end):
    costs = compute_step_costs(MACHINE, start, end)
    delta = MACHINE.cylinder_lengths(end) - MACHINE.cylinder_lengths(start)
    a = MACHINE.arrays
    oil = np.sum(np.where(delta > 0, a.cap_area, a.rod_area) * np.abs(delta))
    for p in np.flatnonzero(costs.admissible):
        normal = a.supply_pressure * (oil + len(delta) * a.leakage_flow * costs.duration[p])
        assert costs.energy[p] >= normal * (1 - 1e-12)
        assert costs.energy_series[p] >= normal * (1 - 1e-12)


@given(postures(), postures())
def test_no_cylinder_is_faster_than_its_mode_allows(start, end):
    costs = compute_step_costs(MACHINE, start, end)
    delta = MACHINE.cylinder_lengths(end) - MACHINE.cylinder_lengths(start)
    a = MACHINE.arrays
    area = np.where(delta > 0, a.cap_area, a.rod_area)
    for p in np.flatnonzero(costs.admissible):
        flow = area * np.abs(delta) / max(costs.duration[p], 1e-12)
        assert np.all(flow / area <= a.max_piston_speed * (1 + 1e-12))
        assert flow.sum() + len(delta) * a.leakage_flow <= a.main_pump_flow * (1 + 1e-12)
        modules = a.modules_per_mode[MACHINE.patterns[p]]
        assert np.all((flow <= modules * a.servo_pump_flow * (1 + 1e-12))[modules > 0])
