"""Machines whose commands act late and whose valves are slow or overlapped."""

from collections.abc import Callable

import numpy as np
import pytest

from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_sim.simulation.simulator import Simulator

Motion = Callable[..., tuple[Trajectory, ModeSchedule]]
WAYS = [np.array(q) for q in ([0.5, -1.1, -1.2], [0.2, -1.7, -0.6], [0.6, -1.0, -1.5])]
TOLERANCE = 2e-3  # m
DELAY, OVERLAP = "imperfections.computing_delay", "imperfections.valve_overlap"
FREQUENCY = "circuit.valve_frequency"
SLOW = 12.7  # Hz, a lag of 20 ms at a damping of 0.8


def follow(simulator: Simulator, motion: Motion, ways: list[np.ndarray]) -> list[float]:
    """Return the tip's distance from its goal after each motion, a second later [m]."""
    away = []
    for goal in ways:
        plan = motion(simulator.reference, goal, simulator.time_ns)
        simulator.set_plan(*plan)
        while simulator.plan_time_ns < plan[0].end_ns + SECOND_NS:
            simulator.step()
        tips = (
            simulator.machine.tip_position(q)
            for q in (simulator.joint_state.position, plan[0].position[-1])
        )
        away.append(float(np.linalg.norm(np.subtract(*tips))))
    return away


@pytest.mark.parametrize(
    "change",
    [
        {DELAY: 0.02},
        {FREQUENCY: SLOW},
        {OVERLAP: 0.25, DELAY: 0.02, FREQUENCY: SLOW},
        {OVERLAP: 0.45, f"{OVERLAP}_retracting": 0.1},
    ],
    ids=["delay", "lag", "overlap, delay and lag", "unequal overlaps"],
)
def test_goals_are_reached_with_a_declared_delay_lag_and_overlap(
    machine: Machine, motion: Motion, change: dict[str, float]
) -> None:
    simulator = Simulator(machine.with_values(change))
    assert max(follow(simulator, motion, WAYS)) < TOLERANCE


def test_a_delay_that_is_not_declared_is_learnt_and_goals_are_reached(
    machine: Machine, motion: Motion
) -> None:
    simulator = Simulator(machine, plant=machine.with_values({DELAY: 0.02}))
    assert max(follow(simulator, motion, WAYS)) < TOLERANCE
    (delay,) = (each.value for each in simulator.estimates if each.quantity == "delay")
    assert delay == pytest.approx(0.02, abs=1.5e-3)


def test_a_valve_lag_that_is_not_declared_is_learnt_and_goals_are_reached(
    machine: Machine, motion: Motion
) -> None:
    simulator = Simulator(machine, plant=machine.with_values({FREQUENCY: SLOW}))
    assert max(follow(simulator, motion, WAYS)) < TOLERANCE
    (lag,) = (each.value for each in simulator.estimates if each.quantity == "valve_lag")
    assert lag == pytest.approx(0.02, abs=5.1e-3)
