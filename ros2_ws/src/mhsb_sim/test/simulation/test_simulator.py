from __future__ import annotations

import gc
import weakref
from collections.abc import Callable
from itertools import combinations, pairwise

import numpy as np
import pytest

from mhsb_control import REGISTERED_CONTROLLERS, load_machine, select_controllers
from mhsb_control.errors import UnknownControllerError
from mhsb_model.errors import MhsbError
from mhsb_model.holding import choose_holding_modes
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.modes import Mode, list_mode_patterns
from mhsb_model.trajectory import SECOND_NS, MotionState, Trajectory, standstill
from mhsb_model.types import FloatArray
from mhsb_sim.circuit.audit import compute_energy_gap, compute_volume_gap
from mhsb_sim.errors import ModeError, SimulationDivergedError
from mhsb_sim.simulation.faults import Fault
from mhsb_sim.simulation.simulator import Simulator

SUITABLE_CONTROLLERS = sorted(select_controllers(load_machine()))
Motion = Callable[..., tuple[Trajectory, ModeSchedule]]

LOWERED = np.array([-0.1, -1.9, -0.7])  # the main pump holds it
LIFTED = np.array([0.55, -1.1, 0.2])  # boost in J1
STRETCHED = np.array([0.4, -0.8, -0.1])  # more of it


def tip_errors(simulator: Simulator, duration: float) -> FloatArray:
    """Distances [m] of the tip from its reference at each step."""
    machine = simulator.machine
    errors = []
    for _ in range(round(duration * SECOND_NS / simulator.step_ns)):
        simulator.step()
        measured = machine.tip_position(simulator.joint_state.position)
        wanted = machine.tip_position(simulator.reference.position)
        errors.append(np.hypot(*(measured - wanted)))
    return np.array(errors)


def with_slow_pumps(machine: Machine) -> Machine:
    circuit = machine.config.circuit.model_copy(update={"servo_pump_lag": 0.08})
    return Machine.from_config(machine.config.model_copy(update={"circuit": circuit}))


def rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def go(simulator: Simulator, motion: Motion, goal: FloatArray, **options: object) -> float:
    """Set a plan from the present reference to a posture; returns its duration [s]."""
    plan = motion(simulator.reference, goal, simulator.time_ns, **options)
    simulator.set_plan(*plan)
    return plan[0].duration_ns / SECOND_NS


@pytest.mark.parametrize(("controller", "hum"), [("coordinated", 1e-3), ("independent", 3e-3)])
def test_it_starts_at_rest_and_holds_but_for_its_hum(
    machine: Machine, controller: str, hum: float
) -> None:
    simulator = Simulator(machine, controller=controller)
    start = np.array(machine.config.simulation.start_posture)
    np.testing.assert_array_equal(simulator.joint_state.position, start)
    errors = tip_errors(simulator, 1.0)
    assert errors.max() < 0.1e-3
    np.testing.assert_allclose(simulator.joint_state.velocity, 0.0, atol=hum)
    assert simulator.time_ns == SECOND_NS
    assert simulator.plan_stamp_ns == 0


def test_cylinder_forces_at_rest_equal_statics(machine: Machine) -> None:
    for posture in (LOWERED, LIFTED, STRETCHED):
        simulator = Simulator(machine, posture=posture)
        simulator.advance(1.0)
        force = simulator.actuator_states.force
        np.testing.assert_allclose(force, machine.piston_forces(posture), atol=15.0)


def test_the_coordinated_servo_follows_a_boosted_lift_within_a_fifth_of_a_millimetre(
    machine: Machine, motion: Motion
) -> None:
    simulator = Simulator(machine, posture=LOWERED)
    duration = go(simulator, motion, LIFTED)
    assert {0, 1, 2} <= set(simulator._reference.schedule.modes[:, 0].tolist())
    errors = tip_errors(simulator, duration)
    assert rms(errors) < 0.1e-3
    assert errors.max() < 0.2e-3
    assert tip_errors(simulator, 1.0)[-300:].max() < 0.1e-3
    assert simulator.energies["relief_valves"] == 0.0


def test_the_servo_knows_the_valve_of_each_actuator(machine: Machine, motion: Motion) -> None:
    """As exactly as with equal valves, and nothing is learnt that the file does not say."""
    flow = machine.config.hydraulics.valve.rated_flow
    arm = machine.with_values(
        {"joints.0.actuator.rated_flow": 1.8 * flow, "joints.2.actuator.rated_flow": 0.5 * flow}
    )
    simulator = Simulator(arm, posture=LOWERED)
    errors = []
    for goal in (LIFTED, LOWERED):
        duration = go(simulator, motion, goal, of=arm)
        errors.append(tip_errors(simulator, duration))
    assert rms(np.concatenate(errors)) < 0.1e-3
    assert np.concatenate(errors).max() < 0.25e-3
    gains = {each.actuator: each for each in simulator.estimates if each.quantity == "valve_gain"}
    for each in gains.values():
        assert each.value == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("controller", SUITABLE_CONTROLLERS)
def test_replans_in_motion_are_followed(machine: Machine, motion: Motion, controller: str) -> None:
    simulator = Simulator(machine, controller=controller, posture=LOWERED)
    errors = []
    for goal in (LIFTED, STRETCHED, LOWERED, LIFTED, STRETCHED):
        go(simulator, motion, goal)
        errors.append(tip_errors(simulator, 2.0))
    simulator.advance(8.0)
    at_rest = tip_errors(simulator, 0.3)
    limit = {"coordinated": 1e-3, "independent": 40e-3}[controller]
    assert rms(np.concatenate(errors)) < limit
    assert at_rest.max() < 1e-3
    assert simulator.energies["relief_valves"] == 0.0


def test_a_load_is_raised_again_by_the_main_pump_after_it_was_lowered(
    machine: Machine, motion: Motion
) -> None:
    """Lowering leaves both chambers above what the line could press into them."""
    folded, low = np.array([1.45, -1.80, -1.5]), np.array([1.45, -1.97, -1.5])
    simulator = Simulator(machine, posture=folded)
    held = np.atleast_2d(simulator.modes)
    assert held[0, 1] == Mode.N
    for goal in (low, folded):
        trajectory, _ = motion(simulator.reference, goal, simulator.time_ns, speed=0.004)
        simulator.set_plan(trajectory, ModeSchedule(simulator.time_ns, np.array([0]), held))
        assert tip_errors(simulator, trajectory.duration_ns / SECOND_NS).max() < 0.5e-3


@pytest.mark.parametrize("payload", [0.0, 13.0])
def test_a_payload_that_the_servo_does_not_know_is_carried(
    machine: Machine, motion: Motion, payload: float
) -> None:
    simulator = Simulator(machine, payload=payload)
    assert tip_errors(simulator, 1.0).max() < 0.1e-3
    duration = go(simulator, motion, STRETCHED, of=machine.changed(payload=payload))
    errors = tip_errors(simulator, duration)
    assert rms(errors) < 1.5e-3
    simulator.advance(2.0)
    assert tip_errors(simulator, 0.3).max() < 0.3e-3


def test_a_slow_servo_pump_is_still_followed(machine: Machine, motion: Motion) -> None:
    simulator = Simulator(with_slow_pumps(machine))
    duration = go(simulator, motion, STRETCHED)
    assert rms(tip_errors(simulator, duration)) < 1e-3


@pytest.mark.parametrize("first", [Mode.DB, Mode.SB])
def test_slow_pumps_overfill_no_line_that_joins_or_leaves_the_rail(
    machine: Machine, first: Mode
) -> None:
    second = Mode.SB if first == Mode.DB else Mode.DB
    modes = np.array([[first, Mode.N, Mode.N], [second, Mode.N, Mode.N]], np.uint8)
    schedule = ModeSchedule(0, np.array([0, SECOND_NS // 2]), modes)
    simulator = Simulator(with_slow_pumps(machine), posture=STRETCHED)
    simulator.set_plan(standstill(STRETCHED), schedule)
    simulator.advance(0.4)
    settled = simulator.actuator_states.supply_pressure[0]
    peak = 0.0
    for _ in range(600):
        simulator.step()
        peak = max(peak, simulator.actuator_states.supply_pressure[0])
    assert settled > machine.arrays.supply_pressure + 2e5
    assert peak < settled + 1.5e5


def test_a_boost_dropped_and_taken_up_again_at_full_speed_is_survived(
    machine: Machine, motion: Motion
) -> None:
    simulator = Simulator(machine, posture=LOWERED)
    trajectory, schedule = motion(simulator.reference, LIFTED)
    begin = int(0.55 * trajectory.duration_ns)
    assert schedule.modes_at_many(np.array([begin]))[0, 0] == Mode.SB
    ms = SECOND_NS // 1000
    offsets = np.array([0, begin, begin + 5 * ms, begin + 10 * ms, trajectory.duration_ns])
    modes = np.array([[2, 0, 0], [1, 0, 0], [2, 0, 0], [2, 0, 0], schedule.modes[-1]], np.uint8)
    simulator.set_plan(trajectory, ModeSchedule(0, offsets, modes))
    errors = tip_errors(simulator, trajectory.duration_ns / SECOND_NS + 1.0)
    assert errors.max() < 5e-3
    assert errors[-300:].max() < 0.2e-3
    assert simulator.energies["relief_valves"] == 0.0


@pytest.mark.parametrize("controller", sorted(REGISTERED_CONTROLLERS))
def test_every_transition_between_patterns_is_finite_and_keeps_its_oil(
    machine: Machine, controller: str
) -> None:
    """All 506 ordered pairs of the 23 patterns, 0.1 s each, under loads that need boost."""
    modules = machine.config.hydraulics.modules
    patterns = list_mode_patterns(machine.joint_count, modules.count, modules.per_mode)
    tour = np.array([p for a, b in combinations(patterns, 2) for p in (a, b)])
    tour = np.vstack([tour, patterns[0]])
    pairs = {(bytes(a), bytes(b)) for a, b in pairwise(tour)}
    assert len(pairs) >= len(patterns) * (len(patterns) - 1)
    simulator = Simulator(machine, controller, posture=STRETCHED)
    hold = standstill(STRETCHED)
    offsets = np.arange(len(tour)) * (SECOND_NS // 10)
    simulator.set_plan(hold, ModeSchedule(0, offsets, tour))
    highest = 0.0
    for _ in tour:
        simulator.advance(0.1)
        highest = max(highest, simulator.actuator_states.supply_pressure.max())
    assert highest < machine.config.circuit.line_relief_pressure
    assert simulator.energies["relief_valves"] == 0.0
    volumes = simulator.volumes
    assert abs(compute_volume_gap(volumes)) < 1e-9 * volumes["main_pump"]
    assert abs(compute_energy_gap(simulator.energies)) < 1e-9 * simulator.energies["main_pump"]


@pytest.mark.parametrize("fault", ["servo_pumps", "main_pump"])
def test_pumps_that_fail_let_the_arm_fall_behind_and_healed_it_catches_up(
    machine: Machine, motion: Motion, fault: str
) -> None:
    simulator = Simulator(machine, posture=LOWERED)
    duration = go(simulator, motion, LIFTED)
    simulator.advance(0.4 * duration)
    assert simulator.modes[0] == Mode.SB
    simulator.inject_faults([Fault(fault)])
    assert tip_errors(simulator, 1.0).max() > 2e-3
    simulator.inject_faults([])
    simulator.advance(0.6 * duration + 3.0)
    assert tip_errors(simulator, 0.3).max() < 0.5e-3


def test_energy_is_accounted_for(machine: Machine, motion: Motion) -> None:
    simulator = Simulator(machine)
    duration = go(simulator, motion, STRETCHED)
    simulator.advance(duration)
    energies = simulator.energies
    assert energies["servo_pumps"] > 10.0
    assert abs(compute_energy_gap(simulator.energies)) < 1e-6 * energies["main_pump"]


def test_the_pistons_do_the_work_that_lifts_the_arm(machine: Machine, motion: Motion) -> None:
    simulator = Simulator(machine)
    before = potential_energy(machine, simulator.joint_state.position)
    duration = go(simulator, motion, STRETCHED)
    simulator.advance(duration + 1.0)
    lifted = potential_energy(machine, simulator.joint_state.position) - before
    spent = simulator.energies["piston_work"] - simulator.energies["friction"]
    assert spent == pytest.approx(lifted, rel=5e-3)


def test_a_simulator_that_is_no_longer_used_leaves_no_memory_behind(machine: Machine) -> None:
    """Its kernels borrow their arrays: none of them counts a reference too many."""
    simulator = Simulator(machine)
    simulator.advance(0.2)
    servo, guarded, circuit = simulator._signals, simulator.guard._state, simulator._circuit
    arrays = [weakref.ref(each) for each in (servo.sensors, guarded.actuators, circuit.pressure)]
    del simulator, servo, guarded, circuit
    gc.collect()
    assert [each() for each in arrays] == [None, None, None]


def potential_energy(machine: Machine, q: FloatArray) -> float:
    heights = np.sin(np.cumsum(q)) * machine.arrays.link_length
    joints = np.concatenate([[0.0], np.cumsum(heights)])
    centers = joints[:-1] + heights * machine.arrays.link_center / machine.arrays.link_length
    moment = centers @ machine.arrays.link_mass + joints[-1] * machine.arrays.payload
    return float(machine.arrays.gravity * moment)


def test_half_the_step_of_the_plant_changes_the_tracking_error_by_less_than_three_percent(
    machine: Machine, motion: Motion
) -> None:
    errors = []
    quiet = machine.with_values({"servo.pressure_noise": 0.0, "servo.length_noise": 0.0})
    for substeps in (1, 2):
        plant = quiet.with_values({"simulation.mechanics_substeps": substeps})
        simulator = Simulator(quiet, posture=LOWERED, plant=plant)
        duration = go(simulator, motion, LIFTED)
        errors.append(tip_errors(simulator, duration))
    coarse, fine = (float(np.sqrt(np.mean(np.square(each)))) for each in errors)
    assert fine > 1e-6
    assert coarse != fine
    assert coarse == pytest.approx(fine, rel=0.03)


def test_half_the_step_changes_little(machine: Machine, motion: Motion) -> None:
    ends = []
    for step in (1e-3, 5e-4):
        settings = machine.config.simulation.model_copy(update={"step": step})
        servo = machine.config.servo.model_copy(update={"pressure_noise": 0.0, "length_noise": 0.0})
        finer = Machine.from_config(
            machine.config.model_copy(update={"simulation": settings, "servo": servo})
        )
        simulator = Simulator(finer, posture=LOWERED)
        duration = go(simulator, motion, LIFTED)
        tips, lines = [], []
        for _ in range(round(duration / 0.01)):
            simulator.advance(0.01)
            tips.append(machine.tip_position(simulator.joint_state.position))
            lines.append(simulator.actuator_states.supply_pressure)
        assert simulator.energies["servo_pumps"] > 10.0
        energy = simulator.energies["main_pump"] + simulator.energies["servo_pumps"]
        ends.append((np.array(tips), np.array(lines), energy))
    (tips, lines, energy), (fine_tips, fine_lines, fine_energy) = ends
    assert np.abs(tips - fine_tips).max() < 0.1e-3
    assert rms(lines - fine_lines) < 20e3
    assert energy == pytest.approx(fine_energy, rel=2e-3)


def test_the_same_seed_gives_the_same_bits_and_another_one_others(
    machine: Machine, motion: Motion
) -> None:
    def run(seed: int) -> bytes:
        simulator = Simulator(machine, seed=seed)
        go(simulator, motion, LIFTED)
        simulator.advance(2.0)
        return simulator.joint_state.position.tobytes() + bytes(
            simulator.actuator_states.cap_pressure
        )

    assert run(1) == run(1)
    assert run(1) != run(2)


def test_a_reset_repeats_the_run(machine: Machine, motion: Motion) -> None:
    simulator = Simulator(machine)
    results = []
    for _ in range(2):
        simulator.reset()
        go(simulator, motion, LIFTED)
        simulator.advance(1.0)
        results.append(simulator.joint_state.position)
    np.testing.assert_array_equal(*results)


def test_a_stop_comes_to_rest_along_the_path_and_holds(machine: Machine, motion: Motion) -> None:
    simulator = Simulator(machine, posture=LOWERED)
    trajectory, schedule = motion(simulator.reference, LIFTED)
    simulator.set_plan(trajectory, schedule)
    simulator.advance(2.0)
    before = simulator.reference
    simulator.stop()
    assert simulator.plan_stamp_ns == 0
    for name in ("position", "velocity", "acceleration"):
        np.testing.assert_allclose(
            getattr(simulator.reference, name), getattr(before, name), atol=1e-9
        )
    assert tip_errors(simulator, 1.0).max() < 0.5e-3
    halted = simulator.reference.position
    np.testing.assert_array_equal(simulator.reference.velocity, 0.0)
    held = choose_holding_modes(machine, machine.piston_forces(halted))
    np.testing.assert_array_equal(simulator.modes, held)
    nearest = np.abs(trajectory.position - halted).max(axis=1).min()
    assert nearest < np.abs(np.diff(trajectory.position, axis=0)).max()
    simulator.stop()
    simulator.advance(0.1)
    np.testing.assert_array_equal(simulator.reference.position, halted)


def test_after_a_stop_a_new_plan_continues(machine: Machine, motion: Motion) -> None:
    simulator = Simulator(machine, posture=LOWERED)
    go(simulator, motion, LIFTED)
    simulator.advance(2.0)
    simulator.stop()
    simulator.advance(0.1)
    braking = simulator.reference
    assert np.abs(braking.velocity).max() > 1e-2
    nearby = braking.position + 0.1 * braking.velocity
    trajectory, _ = motion(braking, nearby, simulator.time_ns)
    boosted = np.array([[Mode.SB, Mode.N, Mode.N]], np.uint8)
    simulator.set_plan(trajectory, ModeSchedule(simulator.time_ns, np.array([0]), boosted))
    np.testing.assert_allclose(simulator.reference.velocity, braking.velocity, atol=1e-9)
    assert tip_errors(simulator, 3.0).max() < 0.5e-3


def test_the_plan_in_force_is_named_until_it_ends(machine: Machine, motion: Motion) -> None:
    simulator = Simulator(machine)
    simulator.advance(0.5)
    duration = go(simulator, motion, np.array([0.35, -1.4, -1.5]))
    stamp = simulator.plan_stamp_ns
    assert stamp == SECOND_NS // 2
    simulator.advance(duration)
    simulator.advance(0.01)
    assert simulator.plan_stamp_ns == 0
    np.testing.assert_allclose(simulator.reference.position, [0.35, -1.4, -1.5], atol=1e-12)


def test_modes_in_force_are_those_of_the_schedule(machine: Machine) -> None:
    simulator = Simulator(machine)
    hold = np.zeros((1, 3))
    position = np.atleast_2d(simulator.reference.position)
    modes = np.array([[0, 0, 0], [0, 1, 0]], np.uint8)
    simulator.set_plan(
        Trajectory(0, np.array([0]), position, hold, hold),
        ModeSchedule(0, np.array([0, SECOND_NS // 2]), modes),
    )
    simulator.advance(0.499)
    np.testing.assert_array_equal(simulator.modes, modes[0])
    simulator.advance(0.002)
    np.testing.assert_array_equal(simulator.modes, modes[1])


def test_a_posture_that_the_main_pump_cannot_hold_starts_boosted(machine: Machine) -> None:
    simulator = Simulator(machine, posture=STRETCHED)
    assert simulator.modes[0] == Mode.DB
    assert tip_errors(simulator, 1.0).max() < 0.2e-3


def test_a_pattern_beyond_the_module_budget_is_an_error(machine: Machine) -> None:
    simulator = Simulator(machine)
    hold = np.zeros((1, 3))
    position = np.atleast_2d(simulator.reference.position)
    with pytest.raises(ModeError, match=r"SB-SB-DB needs 5 booster modules, 4 are fitted"):
        simulator.set_plan(
            Trajectory(0, np.array([0]), position, hold, hold),
            ModeSchedule(0, np.array([0]), np.array([[2, 2, 1]], np.uint8)),
        )


def test_an_unknown_controller_is_named_with_the_valid_ones(machine: Machine) -> None:
    with pytest.raises(
        UnknownControllerError,
        match=r"there is no controller 'pid'; valid are coordinated, independent",
    ):
        Simulator(machine, controller="pid")


@pytest.mark.parametrize(
    ("spoil", "quantity"),
    [
        (lambda s: s._data.qvel.__setitem__(0, np.nan), "the joint velocity"),
        (lambda s: s._data.qpos.__setitem__(0, np.nan), "the joint position"),
        (lambda s: s._circuit.pressure.__setitem__(2, np.nan), "a pressure"),
        (lambda s: s._circuit.actuators["spool"].__setitem__(1, np.nan), "a pressure"),
        (lambda s: s._signals.reference.__setitem__(0, np.nan), "the reference"),
    ],
)
def test_what_is_not_finite_becomes_a_named_error_and_a_reset_cures_it(
    machine: Machine, spoil: Callable[[Simulator], None], quantity: str
) -> None:
    simulator = Simulator(machine)
    simulator.advance(0.1)
    spoil(simulator)
    with pytest.raises(SimulationDivergedError, match=r"diverged at 0.10. s: ") as error:
        simulator.advance(0.01)
    assert isinstance(error.value, MhsbError)
    assert error.value.quantity == quantity
    simulator.reset(3 * SECOND_NS)
    simulator.advance(0.1)
    assert simulator.time_ns == 3 * SECOND_NS + SECOND_NS // 10


def test_end_stops_hold_a_reference_pushed_against_them(machine: Machine) -> None:
    simulator = Simulator(machine, posture=machine.arrays.joint_max - np.array([0.9, 0.005, 0.3]))
    beyond = simulator.reference.position + np.array([0.0, 0.1, 0.0])
    zero = np.zeros((2, 3))
    path = np.array([simulator.reference.position, beyond])
    simulator.set_plan(
        Trajectory(0, np.array([0, 3 * SECOND_NS]), path, zero, zero),
        ModeSchedule(0, np.array([0]), np.atleast_2d(simulator.modes)),
    )
    simulator.advance(5.0)
    assert simulator.joint_state.position[1] < machine.arrays.joint_max[1] + 0.03
    assert np.all(np.isfinite(simulator.actuator_states.cap_pressure))


def test_it_is_remembered_what_was_followed_before(machine: Machine, motion: Motion) -> None:
    simulator = Simulator(machine, start_ns=SECOND_NS)
    simulator.advance(0.1)
    go(simulator, motion, LIFTED)
    simulator.advance(0.5)
    moving = simulator.reference
    simulator.stop()
    simulator.advance(1.0)
    for time_ns, expected in ((11 * SECOND_NS // 10 - 1, 0.0), (16 * SECOND_NS // 10, moving)):
        then = simulator.reference_at(time_ns)
        assert then is not None
        velocity = expected.velocity if isinstance(expected, MotionState) else expected
        np.testing.assert_allclose(then.velocity, velocity, atol=1e-9)
    assert simulator.reference_at(SECOND_NS - 1) is None


def test_closed_valves_hold_until_the_next_plan(machine: Machine, motion: Motion) -> None:
    simulator = Simulator(machine, posture=LIFTED)
    simulator.advance(0.2)
    simulator.close_valves()
    simulator.advance(2.0)
    assert simulator.valves_closed
    assert np.abs(simulator.joint_state.velocity).max() < 1e-5
    simulator.hold_here()
    duration = go(simulator, motion, STRETCHED)
    assert not simulator.valves_closed
    assert tip_errors(simulator, duration)[100:].max() < 2e-3


def test_oil_between_closed_valves_is_let_down_to_where_a_servo_can_begin(machine: Machine) -> None:
    simulator = Simulator(machine)
    simulator.close_valves()
    simulator._circuit.pressure[6:8] += np.array([12e6, 12e6]) * [1.0, 1.0]
    simulator.advance(0.5)
    trapped = simulator.actuator_states
    assert min(trapped.cap_pressure[2], trapped.rod_pressure[2]) > 8e6
    for _ in range(1000):
        if simulator.lower_trapped_pressure(4e4):
            break
        simulator.advance(0.01)
    vented = simulator.actuator_states
    assert min(vented.cap_pressure[2], vented.rod_pressure[2]) < 2.1e6
    np.testing.assert_allclose(vented.force[:2], trapped.force[:2], atol=20.0)
    assert simulator.lower_trapped_pressure(4e4)


def test_a_reset_to_a_posture_rests_there_within_the_limits(machine: Machine) -> None:
    simulator = Simulator(machine)
    simulator.reset(7, machine.arrays.joint_max + 0.01)
    np.testing.assert_array_equal(simulator.reference.position, machine.arrays.joint_max)
    simulator.reset(9)
    np.testing.assert_array_equal(
        simulator.reference.position, machine.config.simulation.start_posture
    )


def test_states_are_copies(machine: Machine) -> None:
    simulator = Simulator(machine)
    state, reference = simulator.joint_state, simulator.reference
    assert isinstance(state, MotionState)
    before = state.position.copy(), reference.position.copy()
    simulator.advance(0.05)
    np.testing.assert_array_equal(state.position, before[0])
    np.testing.assert_array_equal(reference.position, before[1])
