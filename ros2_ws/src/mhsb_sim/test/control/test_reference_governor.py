import numpy as np
import pytest

from mhsb_control.governor import reference_governor
from mhsb_control.governor.reference_governor import (
    GovernedActuator,
    GovernorSettings,
    compute_allowed_rate,
    compute_tip_errors,
    update_alpha_beta_filter,
    update_boost_request,
)
from mhsb_model.hydraulics import compute_pressure_without_margin
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_model.records import create_record, create_records
from mhsb_model.statics import get_chain
from mhsb_sim.simulation.simulator import Simulator

STEP = 1e-3
SETTINGS = GovernorSettings()
RECORD = create_record(SETTINGS)[0]


def test_the_reserve_is_the_pressure_beyond_load_and_valve(machine: Machine) -> None:
    """At rest with everything filtered, a motion upwards ahead of it."""
    simulator = Simulator(machine)
    simulator.advance(0.3)
    state = simulator.guard._state
    velocity = np.array([0.2, -0.1, 0.15])
    state.full_speed_velocity[:] = velocity
    for _ in range(300):
        reference_governor.compute_reserves(state)
    m, states = machine.arrays, simulator.actuator_states
    q = simulator.reference.position
    for j, speed in enumerate(machine.moment_arms(q) * velocity):
        needed = compute_pressure_without_margin(
            m.valve_coefficient[j], m.cap_area[j], m.rod_area[j], m.tank_pressure,
            states.force[j], speed,
        )  # fmt: skip
        in_n = states.supply_pressure.min() - max(needed, 0.0)
        assert state.actuators["reserve_in_n"][j] == pytest.approx(in_n, abs=6e4)
        if simulator.modes[j] != Mode.N:
            own = states.supply_pressure[j] - max(needed, 0.0)
            assert state.actuators["reserve"][j] == pytest.approx(own, abs=6e4)


def test_a_piston_that_stalls_below_its_reference_with_all_pressure_there_is_gets_boost(
    machine: Machine,
) -> None:
    for sagged, asked_for in ((0.0, Mode.N), (0.5e-3, Mode.DB)):
        simulator = Simulator(machine)
        simulator.advance(0.3)
        state = simulator.guard._state
        state.sensors["cap_pressure"][0] = state.sensors["line_pressure"][0]
        state.sensors["rod_pressure"][0] = machine.arrays.tank_pressure
        state.sensors["length"][0] -= sagged
        for _ in range(300):
            reference_governor.run_governor_step(state)
        assert state.actuators["requested_mode"][0] == asked_for


@pytest.mark.parametrize("beyond", [0.5, 2.0])
def test_a_plan_is_held_only_if_a_line_cannot_move_its_load(
    machine: Machine, beyond: float
) -> None:
    """Actuator 1 lags; its line has `beyond` times the needed pressure more than its load."""
    simulator = Simulator(machine)
    simulator.advance(0.3)
    state, cylinder = simulator.guard._state, simulator.guard._state.cylinders[0]
    velocity = np.zeros(machine.joint_count)
    velocity[0] = 0.1 * np.sign(machine.moment_arms(simulator.reference.position)[0])
    state.full_speed_velocity[:] = velocity
    state.speed_scaling["rests"] = 0.0
    carried = state.sensors["line_pressure"][0] - beyond * SETTINGS.min_driving_pressure
    tank = machine.arrays.tank_pressure
    state.sensors["cap_pressure"][0] = carried
    state.sensors["rod_pressure"][0] = tank
    state.sensors["length"][0] -= 0.01
    assert cylinder["min_length"] < state.sensors["length"][0] < cylinder["max_length"]
    for _ in range(1500):
        reference_governor.run_governor_step(state)
    held = beyond < 1.0
    assert state.speed_scaling["rate"][0] == pytest.approx(0.0 if held else SETTINGS.min_rate)
    name = f"{beyond * SETTINGS.min_driving_pressure / 1e6:.2f} MPa beyond its load"
    assert (
        f"the line of {machine.actuator_names[0]} has {name}" in simulator.guard.sentence
    ) == held


def test_overlap_does_not_count_as_opening(machine: Machine) -> None:
    simulator = Simulator(machine)
    state = simulator.guard._state
    state.valve_overlap[:] = 0.4
    state.commands["valve_command"] = -0.7
    for _ in range(1500):
        reference_governor.run_governor_step(state)
    np.testing.assert_allclose(state.actuators["opening"], (0.7 - 0.4) / (1.0 - 0.4), rtol=1e-3)


def test_the_tips_errors_are_those_of_the_postures(machine: Machine) -> None:
    random = np.random.default_rng(1)
    actuators = create_records(GovernedActuator, 3)
    for _ in range(50):
        q = random.uniform(machine.arrays.joint_min, machine.arrays.joint_max)
        off = random.normal(0.0, 1e-4, 3)
        actuators["deviation"] = off
        exact = machine.tip_position(q + off) - machine.tip_position(q)
        speed = random.normal(0.0, 0.1, 3)
        way = machine.tip_position(q + 1e-6 * speed) - machine.tip_position(q)
        ahead = max(0.0, float(exact @ way) / float(np.hypot(*way)))
        error, behind = compute_tip_errors(get_chain(machine.arrays), q, speed, actuators)
        assert error == pytest.approx(float(np.hypot(*exact)), rel=1e-3, abs=1e-7)
        assert behind**2 == pytest.approx(error**2 - ahead**2, rel=5e-3, abs=1e-9)


def test_a_pressure_that_falls_steadily_is_followed_without_lag() -> None:
    value, rate = 4e6, 0.0
    for k in range(1, 200):
        value, rate = update_alpha_beta_filter(
            value, rate, 4e6 - 7e6 * k * STEP, STEP, SETTINGS.filter_gain
        )
    assert value == pytest.approx(4e6 - 7e6 * 199 * STEP, abs=1e3)
    assert rate == pytest.approx(-7e6, rel=1e-2)


def asked(reserves: list[tuple[float, float]], scheduled: bool = False) -> list[int]:
    """What is asked for after each of these reserves [Pa], that last so long [s]."""
    actuators, modes = create_records(GovernedActuator, 1), []
    for reserve, time in reserves:
        actuators["reserve_in_n"] = reserve
        for _ in range(round(time / STEP)):
            update_boost_request(actuators[0], scheduled, STEP, RECORD)
        modes.append(int(actuators["requested_mode"][0]))
    return modes


def test_boost_is_asked_for_at_once_and_kept_until_there_is_plenty_for_a_while() -> None:
    lack, some, plenty = (
        SETTINGS.boost_below - 1e4,
        3e5,
        1.1 * SETTINGS.release_above,
    )
    assert asked([(some, 1.0), (lack, 0.008), (some, 1.0)]) == [Mode.N] * 3
    assert asked([(lack, 0.011), (some, 1.0)]) == [Mode.DB] * 2
    assert asked([(lack, 0.011), (plenty, 0.29), (some, 0.01), (plenty, 0.29)]) == [Mode.DB] * 4
    assert asked([(lack, 0.011), (plenty, 0.31)]) == [Mode.DB, Mode.N]


def test_where_the_plan_boosts_too_nothing_is_kept() -> None:
    assert asked([(-1e6, 0.1), (3e5, 0.02)], scheduled=True) == [Mode.DB, Mode.N]


def test_the_pace_falls_with_the_reserve() -> None:
    actuators = create_records(GovernedActuator, 1)
    for boosted in (False, True):
        shares = []
        for reserve in np.linspace(-5e5, 5e5, 101):
            actuators["reserve"] = reserve
            shares.append(compute_allowed_rate(actuators[0], boosted, RECORD))
        assert shares[0] == 0.0
        assert shares[-1] == 1.0
        assert np.all(np.diff(shares) >= 0.0)


def test_the_pace_falls_while_a_valve_stays_nearly_open() -> None:
    actuators = create_records(GovernedActuator, 1)
    actuators["reserve"] = 1e6
    shares = []
    for opening in np.linspace(0.0, 1.0, 51):
        actuators["opening"] = opening
        shares.append(compute_allowed_rate(actuators[0], False, RECORD))
    assert shares[round(50 * SETTINGS.full_rate_opening)] == pytest.approx(1.0)
    assert shares[-1] == 0.0
    assert np.all(np.diff(shares) <= 0.0)
