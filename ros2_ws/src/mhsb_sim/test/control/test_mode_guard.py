from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mhsb_control import load_machine, select_controllers
from mhsb_control.governor.mode_guard import Interventions
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.modes import Mode
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_sim.simulation.plan_receiver import PlanReceiver
from mhsb_sim.simulation.simulator import Simulator

SUITABLE_CONTROLLERS = sorted(select_controllers(load_machine()))
Motion = Callable[..., tuple[Trajectory, ModeSchedule]]
LOWERED = np.array([-0.1, -1.9, -0.7])
RAISED = np.array([-0.01, -1.67, -0.51])  # in N, with the payload of the file


def run(simulator: Simulator, until_ns: int) -> tuple[float, list[np.ndarray], list[str]]:
    """To a time of plans: the largest distance of the tip [m], modes in force, what was told."""
    machine, worst, modes, told = simulator.plant, 0.0, [simulator.modes], set()
    while simulator.plan_time_ns < until_ns and simulator.time_ns < 3 * until_ns:
        simulator.step()
        wanted, measured = simulator.reference.position, simulator.joint_state.position
        away = machine.tip_position(measured) - machine.tip_position(wanted)
        worst = max(worst, float(np.hypot(*away)))
        if not np.array_equal(modes[-1], simulator.modes):
            modes.append(simulator.modes)
        told.add(simulator.guard.sentence)
    return worst, modes, sorted(told)


@pytest.mark.parametrize("controller", SUITABLE_CONTROLLERS)
def test_it_does_nothing_to_the_machine_that_the_plan_is_made_for(
    machine: Machine, motion: Motion, controller: str
) -> None:
    simulator = Simulator(machine, controller, posture=LOWERED)
    for goal in (np.array([0.55, -1.1, 0.2]), np.array([0.4, -0.8, -0.1]), LOWERED):
        plan = motion(simulator.reference, goal, simulator.time_ns)
        simulator.set_plan(*plan)
        _, _, told = run(simulator, plan[0].end_ns + SECOND_NS // 5)
        assert told == [""]
    assert simulator.guard.interventions == Interventions(0, 0, 0.0)
    assert simulator.plan_delay_ns == 0


def test_a_load_heavier_than_known_is_boosted_and_let_go_without_flicker(
    machine: Machine, motion: Motion
) -> None:
    simulator = Simulator(machine, posture=LOWERED, payload=1.55 * machine.arrays.payload)
    plan = motion(simulator.reference, RAISED)
    assert not plan[1].modes.any()
    simulator.set_plan(*plan)
    worst, modes, told = run(simulator, plan[0].end_ns + SECOND_NS // 5)
    assert worst < 0.01
    assert simulator.guard.interventions.boosts >= 1
    assert max(pattern.max() for pattern in modes) == Mode.DB
    assert len(modes) <= 4
    assert any("where the plan has N-N-N" in sentence for sentence in told)


def test_a_main_pump_with_too_little_flow_makes_the_plan_slower_and_nothing_worse(
    machine: Machine, motion: Motion
) -> None:
    flow = machine.arrays.main_pump_flow
    plant = machine.with_values({"hydraulics.main_pump.max_flow": 0.55 * flow})
    simulator = Simulator(machine, posture=LOWERED, plant=plant)
    plan = motion(simulator.reference, np.array([0.55, -1.1, 0.2]))
    simulator.set_plan(*plan)
    half_ns = plan[0].duration_ns // 2
    worst, _, told = run(simulator, half_ns)
    assert simulator.guard.interventions.slowings >= 1
    assert simulator.plan_delay_ns > SECOND_NS // 200
    assert simulator.plan_stamp_ns == plan[0].stamp_ns
    assert any("later than planned" in sentence for sentence in told)
    later, _, _ = run(simulator, plan[0].end_ns + SECOND_NS // 5)
    assert max(worst, later) < 0.02
    np.testing.assert_allclose(simulator.reference.position, plan[0].position[-1], atol=1e-9)
    assert simulator.plan_delay_ns == 0


def test_a_plan_takes_over_in_the_time_of_plans(machine: Machine, motion: Motion) -> None:
    """It continues the one before at the same place of it, and without a step of the reference."""
    flow = machine.arrays.main_pump_flow
    plant = machine.with_values({"hydraulics.main_pump.max_flow": 0.55 * flow})
    simulator = Simulator(machine, posture=LOWERED, plant=plant)
    receiver = PlanReceiver(machine, simulator)
    goal = np.array([0.55, -1.1, 0.2])
    simulator.set_plan(*motion(simulator.reference, goal))
    while simulator.plan_delay_ns < SECOND_NS // 50:
        simulator.step()
    stamp_ns = simulator.plan_time_ns + SECOND_NS // 20
    there = simulator._reference.trajectory.sample(stamp_ns)
    trajectory, schedule = motion(there, LOWERED, stamp_ns)
    receiver.add_trajectory(trajectory, 0.0)
    receiver.add_schedule(schedule, 0.0)
    reports, before = [], simulator.reference
    while not reports:
        assert simulator.time_ns < 60 * SECOND_NS
        simulator.step()
        before = simulator.reference
        reports = receiver.update(0.0)
    assert reports[0].outcome == "applied", reports[0].sentence
    after = simulator.reference
    np.testing.assert_allclose(after.position, before.position, atol=1e-6)
    np.testing.assert_allclose(after.velocity, before.velocity, atol=1e-5)
    assert simulator.plan_delay_ns > 0
