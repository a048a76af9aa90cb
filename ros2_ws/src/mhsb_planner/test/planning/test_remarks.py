"""A refused plan names a payload that is too heavy, and a start that seems to be in degrees."""

import numpy as np
import pytest

from mhsb_model.trajectory import MotionState
from mhsb_planner.errors import InfeasibleGoalError, NoPathError, StartError
from mhsb_planner.planner import PLANNER_KINDS, Planner, PlanOptions
from mhsb_planner.planning.remarks import describe_overload

GOAL = (0.55, 0.60)


@pytest.fixture
def start(machine):
    return np.array(machine.config.simulation.start_posture)


@pytest.mark.parametrize("kind", PLANNER_KINDS)
def test_no_path_with_a_heavy_payload_names_load_actuator_and_pressure(machine, table, start, kind):
    planner = Planner(machine.changed(payload=400.0), table)
    with pytest.raises(
        NoPathError,
        match=r"; to hold the payload of 400 kg at the start, actuator_\d needs [\d.]+ MPa, "
        r"and the highest pressure is 10 MPa$",
    ):
        planner.plan(GOAL, MotionState.at_rest(start), options=PlanOptions(planner=kind))


def test_a_payload_is_named_where_it_can_be_held_at_the_start_alone(machine, table, start):
    heavy = machine.changed(payload=35.0)
    assert "no posture holds the payload of 35 kg" in describe_overload(heavy, table, start)
    assert describe_overload(machine, table, start) == ""


@pytest.mark.parametrize("kind", PLANNER_KINDS)
def test_a_start_in_degrees_is_asked_about(machine, table, start, kind):
    with pytest.raises(StartError, match=r"; in degrees\? .* degrees are 0\.3 rad; no motion"):
        Planner(machine, table).plan(
            GOAL, MotionState.at_rest(np.degrees(start)), options=PlanOptions(planner=kind)
        )


def test_an_end_link_angle_in_degrees_is_asked_about(machine, table, start):
    turned = 3.0 * np.pi  # by half a turn, which no posture is
    for psi in (turned, (turned - 0.01, turned)):
        with pytest.raises(InfeasibleGoalError, match=r"rad; in degrees\? "):
            Planner(machine, table).plan(
                GOAL, MotionState.at_rest(start), options=PlanOptions(goal_psi=psi)
            )
