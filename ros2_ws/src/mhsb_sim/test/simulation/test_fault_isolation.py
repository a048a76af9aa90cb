"""What is found of each fault, how soon, and that nothing is found where nothing fails."""

from __future__ import annotations

import numpy as np
import pytest

from mhsb_model.machine import Machine
from mhsb_sim.simulation.fault_detection import SupervisionLimits
from mhsb_sim.simulation.faults import parse_faults
from mhsb_sim.simulation.simulator import Simulator
from mhsb_sim.simulation.supervised_arm import SupervisedArm

START = np.array([-0.1, -1.9, -0.7])
LIFTED = np.array([0.55, -1.1, 0.2])


def run(machine: Machine, motion, fault: str, after: float = 1.0) -> tuple[SupervisedArm, float]:
    """An arm that is on its way when something fails; by how much its tip leaves its reference
    until its valves close [m]."""
    arm = SupervisedArm(Simulator(machine, posture=START), SupervisionLimits())
    arm.step(0.0)
    trajectory, schedule = motion(arm.simulator.reference, LIFTED, arm.simulator.time_ns)
    arm.add_trajectory(trajectory, 0.0)
    arm.add_schedule(schedule, 0.0)
    assert arm.plan_stamp_ns == trajectory.stamp_ns
    off = 0.0
    for k in range(5000):
        if k == round(1000 * after):
            arm.simulator.inject_faults(parse_faults(fault, machine))
        arm.step(0.0)
        if k % 10 == 0 and not arm.simulator.valves_closed:
            simulator = arm.simulator
            states = simulator.joint_state, simulator.reference
            tips = [machine.tip_position(state.position) for state in states]
            off = max(off, float(np.hypot(*(tips[0] - tips[1]))))
        if arm.fault:
            break
    return arm, off


@pytest.mark.parametrize(
    ("fault", "sentence", "farthest"),
    [
        (
            "sensor_dead:actuator_2.length",
            "the length sensor of actuator_2 has given no reading",
            2e-3,
        ),
        ("sensor_dead:actuator_1.cap_pressure", "the cap pressure sensor of actuator_1", 2e-3),
        ("sensor_frozen:actuator_2.cap_pressure", "the cap pressure sensor of actuator_2", 0.02),
        ("sensor_frozen:actuator_3.length", "length sensor of actuator_3", 0.05),
        ("length_offset:actuator_1.length", "length sensor of actuator_1 has leapt by", 0.02),
        ("pressure_offset:actuator_3.line_pressure", "line pressure sensor of actuator_3", 0.01),
        ("valve_hard_over:actuator_2", "the valve or the length sensor of actuator_2", 0.06),
        ("valve_hard_over:actuator_3:-1", "the valve or the length sensor of actuator_3", 0.06),
        ("valve_stuck:actuator_1", "the valve or the length sensor of actuator_1", 0.06),
        ("main_pump", "all lines lack", 0.06),
    ],
)
def test_a_part_that_fails_in_motion_is_named_and_the_arm_stopped(
    machine: Machine, motion, fault: str, sentence: str, farthest: float
) -> None:
    arm, off = run(machine, motion, fault)
    assert sentence in arm.fault
    assert off < farthest
    for _ in range(5000):  # it may swing on its oil for a while
        arm.step(0.0)
    assert arm.simulator.energies["relief_valves"] < 1.0
    assert "its reference is where it stands" in arm.fault
    arm.simulator.inject_faults(())
    arm.clear_fault(arm.simulator.time_ns)
    for _ in range(2000):
        arm.step(0.0)
    assert arm.fault == ""


def test_nothing_is_found_where_nothing_fails(machine: Machine, motion) -> None:
    arm, off = run(machine, motion, "none")
    assert arm.fault == arm.warning == ""
    assert off < 2e-3
