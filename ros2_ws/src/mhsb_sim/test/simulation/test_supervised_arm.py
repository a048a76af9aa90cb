from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mhsb_model.arm_reports import HandOverOutcome, HandOverReason
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, MotionState, Trajectory
from mhsb_sim.simulation.fault_detection import SupervisionLimits
from mhsb_sim.simulation.faults import Fault
from mhsb_sim.simulation.simulator import Simulator
from mhsb_sim.simulation.supervised_arm import SupervisedArm

Plan = tuple[Trajectory, ModeSchedule]
Motion = Callable[..., Plan]

GOAL = np.array([0.55, -1.1, 0.2])
MS = SECOND_NS // 1000


@pytest.fixture
def arm(machine: Machine) -> SupervisedArm:
    return make(machine)


def make(machine: Machine) -> SupervisedArm:
    arm = SupervisedArm(Simulator(machine), SupervisionLimits())
    arm.step(0.0)
    return arm


def advance(arm: SupervisedArm, duration: float, until: Callable[[], bool] = lambda: False) -> None:
    for _ in range(round(1000 * duration)):
        if until():
            return
        arm.step(arm.simulator.time_ns / SECOND_NS)


def send(arm: SupervisedArm, plan: Plan) -> None:
    wall = arm.simulator.time_ns / SECOND_NS
    arm.add_trajectory(plan[0], wall)
    arm.add_schedule(plan[1], wall)


def shifted(plan: Plan, delta_ns: int) -> Plan:
    trajectory = plan[0].shifted(delta_ns)
    return trajectory, replace(plan[1], stamp_ns=trajectory.stamp_ns)


def test_a_plan_is_taken_at_the_very_step_of_its_stamp(arm: SupervisedArm, motion: Motion) -> None:
    """Whose first point is the only one that both share, though many steps are made at once."""
    now_ns = arm.simulator.time_ns
    send(arm, motion(arm.simulator.reference, GOAL, now_ns + 7 * MS))
    assert arm.take_reports() == []
    for _ in range(7):
        arm.step(0.0)
    (report,) = arm.take_reports()
    assert report.outcome is HandOverOutcome.APPLIED
    assert arm.plan_stamp_ns == now_ns + 7 * MS


def test_after_a_stop_no_plan_that_came_before_starts_the_arm(
    arm: SupervisedArm, motion: Motion
) -> None:
    first = arm.simulator.reference
    plan = motion(first, GOAL, arm.simulator.time_ns + 50 * MS)
    send(arm, plan)
    arm.add_trajectory(shifted(plan, 10 * MS)[0], 0.0)  # one more, half of which is still to come
    assert [report.reason for report in arm.take_reports()] == [HandOverReason.NEWER]
    assert not arm.stop()
    assert [report.reason for report in arm.take_reports()] == [HandOverReason.STOPPED]
    arm.add_schedule(shifted(plan, 10 * MS)[1], 0.0)
    send(arm, shifted(plan, -50 * MS - 1))
    advance(arm, 0.3)
    np.testing.assert_array_equal(arm.simulator.reference.position, first.position)
    assert [report.reason for report in arm.take_reports()] == [HandOverReason.STOPPED]
    send(arm, motion(first, GOAL, arm.simulator.time_ns + 1))
    advance(arm, 0.1)
    assert arm.plan_stamp_ns > 0


def test_a_reset_forgets_plans_in_force_and_those_that_wait(
    arm: SupervisedArm, motion: Motion
) -> None:
    start = arm.simulator.reference.position
    send(arm, motion(arm.simulator.reference, GOAL, arm.simulator.time_ns))
    advance(arm, 1.0)
    assert arm.plan_stamp_ns > 0
    ahead_ns = arm.simulator.time_ns + 100 * MS
    continued = arm.simulator._reference.trajectory.sample(ahead_ns)
    send(arm, motion(continued, GOAL, ahead_ns))
    arm.take_reports()
    arm.reset(0)
    assert [report.reason for report in arm.take_reports()] == [HandOverReason.RESET]
    advance(arm, 1.5)
    assert arm.plan_stamp_ns == 0
    np.testing.assert_array_equal(arm.simulator.reference.position, start)


def test_a_fault_is_latched_until_it_is_cleared_and_plans_are_refused_meanwhile(
    arm: SupervisedArm, motion: Motion
) -> None:
    send(arm, motion(arm.simulator.reference, GOAL, arm.simulator.time_ns))
    advance(arm, 1.2)
    arm.simulator.inject_faults([Fault("main_pump")])
    advance(arm, 3.0, lambda: bool(arm.fault))
    assert "is allowed: the arm is being stopped; call ~/clear_faults" in arm.fault
    assert arm.plan_stamp_ns == 0
    arm.take_reports()
    send(arm, motion(MotionState.at_rest(GOAL), GOAL, arm.simulator.time_ns))
    (report,) = arm.take_reports()
    assert report.reason is HandOverReason.FAULT
    advance(arm, 3.0)
    assert "its reference is where it stands" in arm.fault
    arm.simulator.inject_faults([])
    advance(arm, 1.0)
    assert arm.fault
    assert "as soon as the arm rests" in arm.clear_fault(arm.simulator.time_ns)
    advance(arm, 1.0)
    assert arm.fault == ""
    send(arm, motion(arm.simulator.reference, GOAL, arm.simulator.time_ns + MS))
    advance(arm, 0.01)
    assert arm.take_reports()[-1].outcome is HandOverOutcome.APPLIED
    assert arm.clear_fault(0) == "there is no fault"


def test_a_fault_cleared_while_the_arm_is_still_moving_is_cleared_when_it_rests(
    arm: SupervisedArm, motion: Motion
) -> None:
    send(arm, motion(arm.simulator.reference, GOAL, arm.simulator.time_ns))
    advance(arm, 1.2)
    arm.simulator.inject_faults([Fault("main_pump")])
    advance(arm, 3.0, lambda: bool(arm.fault))
    arm.simulator.inject_faults([])
    arm.clear_fault(arm.simulator.time_ns)
    assert "it is cleared when the arm rests" in arm.fault
    advance(arm, 4.0, lambda: not arm.fault)
    assert arm.fault == ""


@pytest.mark.parametrize(
    ("place", "spool", "stops"),
    [(0, -0.02, False), (1, 0.05, False), (2, 0.02, False), (0, -0.02, True)],
)
def test_an_arm_is_led_back_slowly_from_a_stuck_valve_that_is_healed_before_it_is_closed(
    arm: SupervisedArm, place: int, spool: float, stops: bool
) -> None:
    """The servo takes the drift for an overlap, by which it would open the healed valve."""
    advance(arm, 0.2)
    arm.simulator.spools[place] = spool
    arm.simulator.inject_faults([Fault("valve_stuck", place)])
    advance(arm, 2.0, lambda: bool(arm.fault if stops else arm.warning))
    assert bool(arm.fault) is stops
    assert not arm.simulator.valves_closed
    off = arm.simulator.reference.position - arm.simulator.joint_state.position
    assert np.abs(off).max() > 0.01
    arm.simulator.inject_faults([])
    arm.clear_fault(arm.simulator.time_ns)
    before, fastest = arm.simulator.joint_state.position, 0.0
    for _ in range(15):
        advance(arm, 0.1)
        now = arm.simulator.joint_state.position
        fastest, before = max(fastest, np.abs(now - before).max() / 0.1), now
    assert fastest < 0.05


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("place", [0, 1, 2])
def test_a_joint_that_a_valve_has_pressed_on_its_end_stop_does_not_sink_when_it_is_released(
    machine: Machine, place: int, sign: int
) -> None:
    limit = machine.arrays.joint_max if sign > 0 else machine.arrays.joint_min
    posture = np.array(machine.config.simulation.start_posture)
    posture[place] = limit[place] - sign * 0.002
    arm = SupervisedArm(Simulator(machine, posture=posture), SupervisionLimits())
    advance(arm, 0.5)
    arm.simulator.inject_faults([Fault("valve_hard_over", place, sign)])
    advance(arm, 3.0, lambda: arm.simulator.valves_closed)
    advance(arm, 1.0)
    arm.simulator.inject_faults([])
    arm.clear_fault(arm.simulator.time_ns)
    advance(arm, 5.0, lambda: not arm.fault)
    assert arm.fault == ""
    beyond = sign * (arm.simulator.joint_state.position - limit)[place]
    assert -0.002 < beyond < 0.002


def test_a_load_that_falls_onto_the_arm_is_taken_off_gently(arm: SupervisedArm) -> None:
    arm.set_payload(2000.0)
    advance(arm, 0.5)
    assert "joint_1 is 0.07" in arm.fault
    advance(arm, 30.0)
    arm.set_payload(10.0)
    arm.clear_fault(arm.simulator.time_ns)
    fastest = np.zeros(3)

    def cleared() -> bool:
        np.maximum(fastest, np.abs(arm.simulator.joint_state.velocity), out=fastest)
        return not arm.fault

    advance(arm, 20.0, cleared)
    advance(arm, 2.0, lambda: cleared() and False)
    assert arm.fault == ""
    assert arm.simulator.payload == 10.0
    assert fastest.max() < 0.05


def test_a_simulation_that_diverged_goes_on_at_rest_from_where_the_arm_was(
    arm: SupervisedArm, motion: Motion
) -> None:
    send(arm, motion(arm.simulator.reference, GOAL, arm.simulator.time_ns))
    advance(arm, 1.2)
    arm.simulator._circuit.pressure[2] = np.nan
    arm.step(0.0)
    assert arm.halted
    assert "a pressure is no longer finite" in arm.fault
    assert arm.plan_stamp_ns == 0
    at_ns, where = arm.simulator.time_ns, arm.simulator.joint_state.position
    advance(arm, 0.1)
    assert arm.simulator.time_ns == at_ns
    arm.take_reports()
    send(arm, motion(arm.simulator.reference, GOAL, at_ns))
    assert [report.reason for report in arm.take_reports()] == [HandOverReason.FAULT]
    arm.clear_fault(at_ns + 5 * SECOND_NS)
    np.testing.assert_array_equal(arm.simulator.reference.position, where)
    assert arm.simulator.time_ns == at_ns + 5 * SECOND_NS
    advance(arm, 0.5)
    assert np.abs(arm.simulator.joint_state.position - where).max() < 1e-3
    assert np.abs(arm.simulator.joint_state.velocity).max() < 0.05


def test_a_circuit_that_is_not_finite_is_a_fault_that_can_be_cleared(arm: SupervisedArm) -> None:
    arm.simulator._circuit.pressure[2] = np.nan
    arm.step(0.0)
    assert "a pressure is no longer finite" in arm.fault
    arm.clear_fault(arm.simulator.time_ns)
    advance(arm, 0.2)
    assert arm.fault == ""


def test_a_posture_that_is_not_finite_is_left_for_the_start(arm: SupervisedArm) -> None:
    start = arm.simulator.reference.position
    arm.simulator._data.qpos[:] = np.nan
    arm.step(0.0)
    assert arm.halted
    arm.clear_fault(arm.simulator.time_ns)
    np.testing.assert_array_equal(arm.simulator.reference.position, start)


EVENTS = st.lists(
    st.one_of(
        st.tuples(st.just("plan"), st.integers(0, 3)),
        st.tuples(st.sampled_from(["half", "old"]), st.just(0)),
        st.tuples(st.just("run"), st.integers(1, 400)),
        st.tuples(st.sampled_from(["stop", "clear", "main_pump", "none", "nan"]), st.just(0)),
        st.tuples(st.just("payload"), st.sampled_from([0, 10, 2000])),
    ),
    max_size=20,
)
GOALS = np.array([[0.55, -1.1, 0.2], [0.3, -1.4, -1.5], [0.4, -0.8, -0.1], [-0.1, -1.9, -0.7]])


@settings(max_examples=12, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(EVENTS)
def test_whatever_happens_the_reference_steps_only_where_a_stopped_arm_is_set_to_rest(
    machine: Machine, motion: Motion, events: list[tuple[str, int]]
) -> None:
    """Plans, stops, faults, loads and clearings in any order, in lock-step."""
    arm = make(machine)
    simulator = arm.simulator
    told: Counter[int] = Counter()
    sent: set[int] = set()
    before = simulator.reference

    def step() -> None:
        nonlocal before
        held = arm.supervision.phase, arm.halted
        arm.step(simulator.time_ns / SECOND_NS)
        now = simulator.reference
        off = np.abs(now.position - before.position - 1e-3 * before.velocity).max()
        if off > 1e-5:
            assert (arm.supervision.phase, arm.halted) != held
            assert not now.velocity.any()
            assert arm.plan_stamp_ns == 0
        before = now

    for kind, number in events:
        if kind == "plan":
            if not simulator.reference.acceleration.any():  # else there may be none so simple
                stamp_ns = simulator.time_ns + 20 * MS + number
                sent.add(stamp_ns)
                send(arm, motion(simulator.reference, GOALS[number], stamp_ns))
        elif kind == "half":
            stamp_ns = simulator.time_ns + 5 * MS + 1
            sent.add(stamp_ns)
            arm.add_trajectory(motion(MotionState.at_rest(GOAL), GOAL, stamp_ns)[0], 0.0)
        elif kind == "old":
            sent.add(0)
            send(arm, motion(MotionState.at_rest(GOAL), GOAL, 0))
        elif kind == "run":
            for _ in range(number):
                step()
        elif kind == "stop":
            arm.stop()
        elif kind == "clear":
            halted = arm.halted
            arm.clear_fault(simulator.time_ns)
            before = simulator.reference if halted else before
        elif kind == "nan":
            simulator._circuit.pressure[2] = np.nan
        elif kind == "payload":
            arm.set_payload(float(number))
        elif not arm.halted:
            simulator.inject_faults([] if kind == "none" else [Fault(kind)])
        told.update(report.plan_stamp_ns for report in arm.take_reports())
    for _ in range(700):
        step()
    told.update(report.plan_stamp_ns for report in arm.take_reports())
    assert set(told) <= sent
    assert set(told.values()) <= {1}
    if not arm.halted:
        assert set(told) == sent
