import numpy as np
import pytest

from mhsb_model.command import Command
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_sim.simulation.simulator import Simulator
from mhsb_tools.study.draw_measures import (
    LEARNING_TIME,
    compute_planned_time,
    compute_rest_error,
    find_row_moved_both_ways,
    flow_suffices,
    measure_spool_deviation,
    read_payload_estimate,
)
from mhsb_tools.study.replay import Replay

STEP = 0.01


def swing(machine: Machine, amplitude: float, duration: float) -> Command:
    """Joint 1 to and fro about the start posture, q₀ + A (1 − cos ωt)/2, in N."""
    time = np.arange(0.0, duration + 1e-9, 0.02)
    omega = 2.0 * np.pi / duration
    start = np.array(machine.config.simulation.start_posture)
    position = np.tile(start, (len(time), 1))
    velocity, acceleration = np.zeros_like(position), np.zeros_like(position)
    position[:, 0] += 0.5 * amplitude * (1.0 - np.cos(omega * time))
    velocity[:, 0] = 0.5 * amplitude * omega * np.sin(omega * time)
    acceleration[:, 0] = 0.5 * amplitude * omega**2 * np.cos(omega * time)
    offset = np.rint(time * SECOND_NS).astype(np.int64)
    modes = ModeSchedule(0, np.array([0]), np.zeros((1, machine.joint_count), np.uint8))
    return Command(Trajectory(0, offset, position, velocity, acceleration), modes)


def run_with(velocity: np.ndarray, payload: np.ndarray) -> Replay:
    reference = np.zeros((len(velocity), 3, 3))
    reference[:, 1, : velocity.shape[1]] = velocity
    rows = len(velocity)
    return Replay(
        STEP, reference, np.zeros((rows, 3)), np.zeros((rows, 12)), np.zeros((rows, 3)), {}, 0,
        payload,
    )  # fmt: skip


def test_the_payload_is_looked_at_once_joints_have_moved_long_enough_and_both_ways(
    machine: Machine,
) -> None:
    still, up, down = np.zeros((100, 2)), np.ones((600, 2)), -np.ones((200, 2))
    velocity = np.concatenate([still, up, still, down])
    row = find_row_moved_both_ways(velocity, STEP)
    assert row == 100 + 600 + 100 + 50 - 1  # of the way down half a second
    assert find_row_moved_both_ways(np.concatenate([still, up, still]), STEP) is None
    short = np.concatenate([up[:200], down[:100], still])
    assert 300 * STEP < LEARNING_TIME
    assert find_row_moved_both_ways(short, STEP) is None
    truth = machine.arrays.payload
    learnt = np.array([[7.0, 0.5 * truth, 0.1], [8.5, 1.02 * truth, 0.02 * truth]])
    told = read_payload_estimate(machine, run_with(velocity, learnt))
    assert told is not None
    assert told.error_percent == pytest.approx(2.0)
    assert told.holds
    sure = learnt.copy()
    sure[1, 2] = 0.01 * truth
    told = read_payload_estimate(machine, run_with(velocity, sure))
    assert told is not None
    assert not told.holds
    assert read_payload_estimate(machine, run_with(velocity, learnt[:0])) is None


def test_at_rest_a_spool_stands_still_unless_a_swing_keeps_itself_up(machine: Machine) -> None:
    calm = measure_spool_deviation(Simulator(machine))
    late = machine.with_values(
        {"imperfections.computing_delay": 0.02, "circuit.bulk_modulus": 1.6e9}
    )
    swinging = Simulator(machine, plant=late)
    swinging.advance(1.0)
    assert calm < 0.1
    assert measure_spool_deviation(swinging) > 5.0 * calm


def test_the_last_second_is_what_counts_as_rest() -> None:
    error = np.concatenate([np.full(300, 9.0), np.linspace(0.0, 1.0, 101)[:100]])
    assert compute_rest_error(error, STEP) == pytest.approx(0.95, abs=0.02)


def test_flow_suffices_where_strokes_and_leakage_are_within_the_main_pumps(
    machine: Machine,
) -> None:
    command = swing(machine, 0.3, 6.0)
    m = machine.arrays
    arm = machine.moment_arms(command.trajectory.position[0])[0]
    fastest = 1.05 * abs(arm) * np.abs(command.trajectory.velocity[:, 0]).max()
    taken = m.cap_area[0] * fastest + machine.joint_count * m.leakage_flow
    for flow, suffices in ((1.2 * taken, True), (0.85 * taken, False)):
        plant = machine.with_values({"hydraulics.main_pump.max_flow": float(flow)})
        assert plant.arrays.main_pump_flow == pytest.approx(flow, rel=1e-6)
        assert flow_suffices(machine, plant, [command]) is suffices
    assert compute_planned_time([command]) == pytest.approx(6.0)
    assert compute_planned_time([]) == 0.0
