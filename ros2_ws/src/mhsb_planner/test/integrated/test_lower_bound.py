"""The lower bound over all goal postures, against dense samples and an exhaustive search."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.lower_bounds import energy_lower_bound

from mhsb_model.types import frozen
from mhsb_planner.errors import InfeasibleGoalError
from mhsb_planner.integrated.goal_postures import sample_goal_postures
from mhsb_planner.integrated.lower_bound import bound_cost_to_goals, enclose_cell
from mhsb_planner.search.s2_step import compute_hydraulic_coefficients

ENERGY = frozen([1.0, 0.0])
SECONDS = frozen([0.0, 1.0])


def bound(machine, start, goals, weight=ENERGY):
    circuit = compute_hydraulic_coefficients(machine.arrays, machine.patterns)
    return bound_cost_to_goals(machine, circuit, machine.cylinder_lengths(start), goals, weight)


@pytest.mark.parametrize("seed", range(15))
def test_the_bound_is_the_least_over_densely_sampled_goal_postures(arm, posture_within, seed):
    random = np.random.default_rng(seed)
    start, end = posture_within(arm, random), posture_within(arm, random)
    x, z = arm.tip_position(end)
    sampled = energy_lower_bound(
        arm, start, np.vstack([arm.postures(x, z, np.linspace(-np.pi, np.pi, 20001)), end])
    )
    found = bound(arm, start, sample_goal_postures(arm, x, z))
    assert found <= sampled * (1 + 1e-9)
    assert found == pytest.approx(sampled, rel=2e-3)


@given(
    low=st.floats(-7.0, 7.0),
    width=st.floats(1e-6, 3.0),
    radius=st.floats(0.2, 1.02),
    direction=st.floats(-1.5, 1.5),
    elbow=st.sampled_from([-1, 1]),
)
def test_a_cell_of_psi_encloses_all_its_postures(machine, low, width, radius, direction, elbow):
    tip = radius * np.cos(direction), radius * np.sin(direction)
    box = np.empty((2, 3))
    some = enclose_cell(machine.arrays, tip, elbow, np.array([[low, low + width]]), box)
    for psi in low + width * np.linspace(0.0, 1.0, 50):
        for q in machine.postures(*tip, np.array([psi])):
            if np.sign(q[1]) in (elbow, 0):
                length = machine.cylinder_lengths(q)
                assert some
                assert np.all(box[0] - 1e-7 <= length)
                assert np.all(length <= box[1] + 1e-7)


def test_with_psi_given_the_bound_is_that_of_the_postures_with_it(arm, posture_within):
    random = np.random.default_rng(3)
    start, end = posture_within(arm, random), posture_within(arm, random)
    x, z = arm.tip_position(end)
    goals = sample_goal_postures(arm, x, z, psi=end.sum())
    exact = energy_lower_bound(arm, start, goals.posture)
    assert bound(arm, start, goals) == pytest.approx(exact, rel=1e-6)


def test_the_bound_on_time_is_the_longest_stroke_at_v_max(machine, posture_within):
    random = np.random.default_rng(5)
    start, end = posture_within(machine, random), posture_within(machine, random)
    x, z = machine.tip_position(end)
    goals = sample_goal_postures(machine, x, z, psi=float(end.sum()))
    stroke = np.abs(goals.length - machine.cylinder_lengths(start))
    expected = (stroke / machine.arrays.max_piston_speed).max(axis=1).min()
    assert bound(machine, start, goals, SECONDS) == pytest.approx(expected, rel=1e-6)


def test_a_goal_out_of_reach_has_no_postures(machine):
    with pytest.raises(InfeasibleGoalError):
        sample_goal_postures(machine, 0.55, 0.2, psi=3.1)
