"""The coordinated servo on valves with pressure compensators."""

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_sim.simulation.simulator import Simulator

WAY, DURATION = np.array([0.25, 0.2, -0.2]), 4.0


def measure_tip_error(known: Machine, plant: Machine) -> tuple[float, np.ndarray]:
    """Largest distance of the tip from its reference [m], and the valve commands, float64[k, n]."""
    simulator = Simulator(known, "coordinated", plant=plant)
    share = np.linspace(0.0, 1.0, 81)
    profile = share**3 * (10 - 15 * share + 6 * share**2)
    rate = 30 * share**2 * (1 - share) ** 2 / DURATION
    change = 60 * share * (1 - share) * (1 - 2 * share) / DURATION**2
    offsets = np.round(share * DURATION * SECOND_NS).astype(np.int64)
    q = simulator.reference.position + np.outer(profile, WAY)
    motion = Trajectory(0, offsets, q, np.outer(rate, WAY), np.outer(change, WAY))
    simulator.set_plan(motion, ModeSchedule(0, np.array([0]), simulator.modes[None, :]))
    errors, commands = [], []
    while simulator.plan_time_ns < motion.end_ns:
        simulator.advance(0.02)
        apart = known.tip_in_base(simulator.joint_state.position) - known.tip_in_base(
            simulator.reference.position
        )
        errors.append(float(np.linalg.norm(apart)))
        commands.append(simulator.actuator_states.valve_command)
    return max(errors), np.array(commands)


def test_the_servo_opens_compensated_valves_further(machine: Machine) -> None:
    compensated = machine.with_values({"hydraulics.valve.compensated_drop": 3e5})
    error, commands = measure_tip_error(compensated, compensated)
    usual, narrow = measure_tip_error(machine, machine)
    assert usual < 2e-4  # measured: 0.04 mm each
    assert error < 2e-4
    # each edge keeps at most 0.3 MPa of the drop that it has without compensators
    assert np.median(np.abs(commands)) > 1.5 * np.median(np.abs(narrow))


def test_the_servo_learns_compensators_that_its_file_does_not_have(machine: Machine) -> None:
    plant = machine.with_values({"hydraulics.valve.compensated_drop": 3e5})
    error, _ = measure_tip_error(machine, plant)
    assert error < 1e-3  # measured: 0.25 mm
