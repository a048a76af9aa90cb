"""Planned and simulated energy of the same motion, element by element."""

from __future__ import annotations

import numpy as np
import pytest

from mhsb_model.trajectory import MotionState
from mhsb_planner.motion.energy import compute_motion_energy
from mhsb_sim.circuit.valves.registry import VALVE_KINDS
from mhsb_sim.simulation.simulator import Simulator
from mhsb_tools.study.energy_comparison import (
    OTHER_LOSSES,
    as_text,
    list_energy_parts,
    sum_parts,
)

LOW, HIGH = np.array([-0.1, -0.3, -0.4]), np.array([0.2, -0.2, -0.4])


@pytest.fixture(scope="module", params=[(LOW, HIGH), (HIGH, LOW)], ids=["lifted", "lowered"])
def elements(request, machine, motion):
    """A load that needs boost, lifted or lowered and then held for a while."""
    start, goal = request.param
    trajectory, schedule = motion(MotionState.at_rest(start), goal)
    simulator = Simulator(machine, posture=start)
    simulator.set_plan(trajectory, schedule)
    while simulator.time_ns < trajectory.end_ns:
        simulator.step()
    return list_energy_parts(
        compute_motion_energy(machine, trajectory, schedule), simulator.energies
    )


def by_name(elements):
    return {element.name: element for element in elements}


def test_what_is_delivered_goes_somewhere(elements):
    named = by_name(elements)
    sources = named["by the main pump"], named["by the servo pumps"]
    for side in ("planned", "simulated"):
        delivered = getattr(named["delivered"], side)
        assert delivered == pytest.approx(sum(getattr(part, side) for part in sources))
        used = sum(getattr(element, side) for element in elements[3:])
        assert used == pytest.approx(delivered, rel=2e-3)


def test_planned_and_simulated_energy_agree_in_every_element(elements):
    named = by_name(elements)
    delivered = named["delivered"]
    assert delivered.planned == pytest.approx(delivered.simulated, rel=0.15)
    for element in elements:
        assert abs(element.simulated - element.planned) < 0.1 * delivered.simulated, element


def test_servo_pumps_take_what_was_planned_charging_and_inertia_included(elements):
    pumps = by_name(elements)["by the servo pumps"]
    assert pumps.simulated > 10.0
    assert pumps.planned == pytest.approx(pumps.simulated, rel=0.05)


def test_runs_add_up_and_are_printed(elements):
    doubled = sum_parts([elements, elements])
    assert doubled[0].planned == pytest.approx(2 * elements[0].planned)
    lines = as_text(elements)
    assert len(lines) == len(elements) + 2
    assert "leakage" in lines[6]


def test_the_loss_of_every_kind_of_valve_is_among_the_other_valves():
    assert {kind.name for kind in VALVE_KINDS} <= set(OTHER_LOSSES)
