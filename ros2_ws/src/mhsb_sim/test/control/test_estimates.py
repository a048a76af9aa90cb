from collections.abc import Callable

import numpy as np
import pytest

from mhsb_model.arm_reports import Estimate
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_sim.simulation.simulator import Simulator

Motion = Callable[..., tuple[Trajectory, ModeSchedule]]
WAYS = [np.array(q) for q in ([0.5, -1.1, -1.2], [0.2, -1.7, -0.6], [0.6, -1.0, -1.5])]
TRUTH = {"payload": 8.0, "friction": 1.6, "valve_gain": 0.85, "overlap": 0.02, "leakage": 0.7}


def plant_of(machine: Machine) -> Machine:
    """What is true of another machine."""
    oil, valve = "circuit.", "hydraulics.valve."
    return machine.with_values(
        {
            "payload.mass": TRUTH["payload"],
            f"{oil}coulomb_friction": TRUTH["friction"] * machine.value(f"{oil}coulomb_friction"),
            f"{oil}viscous_friction": TRUTH["friction"] * machine.value(f"{oil}viscous_friction"),
            f"{valve}rated_flow": TRUTH["valve_gain"] * machine.value(f"{valve}rated_flow"),
            f"{valve}leakage_flow": TRUTH["leakage"] * machine.value(f"{valve}leakage_flow"),
            "imperfections.valve_overlap": TRUTH["overlap"],
        }
    )


def estimates(simulator: Simulator) -> list[Estimate]:
    return simulator.estimates


def test_of_valves_of_their_own_the_smaller_one_is_found_out(
    machine: Machine, motion: Motion
) -> None:
    """That of actuator 2 passes a fifth less than the servo knows of it, in circuit and MuJoCo."""
    flow, believed = machine.value("hydraulics.valve.rated_flow"), {}
    for j, size in enumerate((1.5, 0.8, 0.6)):
        believed[f"joints.{j}.actuator.rated_flow"] = size * flow
    arm = machine.with_values(believed)
    plant = arm.with_values({"joints.1.actuator.rated_flow": 0.8 * 0.8 * flow})
    simulator = Simulator(arm, plant=plant)
    for goal in WAYS * 2:
        plan = motion(simulator.reference, goal, simulator.time_ns, of=arm)
        simulator.set_plan(*plan)
        simulator.advance(plan[0].duration_ns / SECOND_NS + 0.3)
    gains = [each for each in estimates(simulator) if each.quantity == "valve_gain"]
    for each, true in zip(gains, (1.0, 0.8, 1.0), strict=True):
        assert each.value == pytest.approx(true, abs=0.05), each


def test_at_rest_nothing_is_known(machine: Machine) -> None:
    simulator = Simulator(machine, plant=plant_of(machine))
    simulator.advance(1.0)
    moving = [each for each in estimates(simulator) if each.quantity != "leakage"]
    assert not any(each.known for each in moving)


def test_a_few_motions_tell_what_the_plant_is_like_and_the_arm_rests_where_it_should(
    machine: Machine, motion: Motion
) -> None:
    simulator = Simulator(machine, plant=plant_of(machine))
    for goal in WAYS * 3:
        plan = motion(simulator.reference, goal, simulator.time_ns)
        simulator.set_plan(*plan)
        while simulator.plan_time_ns < plan[0].end_ns + SECOND_NS // 2:
            simulator.step()
    known = [each for each in estimates(simulator) if each.known and each.quantity in TRUTH]
    assert {"payload", "friction", "valve_gain", "overlap"} <= {each.quantity for each in known}
    for each in known:
        assert abs(each.value - TRUTH[each.quantity]) < 4.0 * each.deviation, each
    tips = [
        machine.tip_position(q)
        for q in (simulator.joint_state.position, simulator.reference.position)
    ]
    assert np.hypot(*(tips[0] - tips[1])) < 1e-3
