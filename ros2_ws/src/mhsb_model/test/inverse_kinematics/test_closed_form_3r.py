"""Closed-form inverse kinematics, against forward kinematics."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mhsb_model import kinematics
from mhsb_model.inverse_kinematics import closed_form_3r


@given(st.floats(0, 1), st.floats(-1, 1), st.floats(-math.pi, math.pi), st.sampled_from([-1, 1]))
def test_every_solution_reaches_the_tip_with_the_asked_end_link_angle(machine, x, z, psi, elbow):
    q = np.empty(3)
    if not closed_form_3r.solve_last_three_joints(machine.arrays, x, z, psi, elbow, q):
        wrist = np.array([x, z]) - 0.179 * np.array([math.cos(psi), math.sin(psi)])
        assert not 0.05 < np.linalg.norm(wrist) < 0.85
        return
    assert kinematics.tip_position(machine.arrays, q) == pytest.approx((x, z), abs=1e-7)
    assert math.cos(q.sum() - psi) == pytest.approx(1.0, abs=1e-12)
    assert math.sin(q[1]) * elbow >= -1e-7


@given(*(st.floats(0.001, 0.999) for _ in range(3)))
def test_the_posture_of_any_reachable_tip_is_among_the_solutions(slider_crank_machine, a, b, c):
    machine = slider_crank_machine
    lower, upper = machine.arrays.joint_min, machine.arrays.joint_max
    q = lower + np.array([a, b, c]) * (upper - lower)
    x, z = machine.tip_position(q)
    found = machine.postures(x, z, np.array([q.sum()]))
    assert min((np.abs(found - q).max() for found in found), default=9.0) < 1e-6 or abs(q[1]) < 1e-6


@given(st.floats(-50, 50), st.floats(-7, 7))
def test_wrapping_changes_an_angle_by_whole_turns_to_within_half_a_turn(angle, center):
    wrapped = closed_form_3r.wrap_near(angle, center)
    turns = (wrapped - angle) / (2 * math.pi)
    assert turns == pytest.approx(round(turns), abs=1e-9)
    assert abs(wrapped - center) <= math.pi + 1e-9


def test_postures_lie_within_the_joint_limits(machine):
    found = machine.postures(0.55, -0.05, np.linspace(-math.pi, math.pi, 720))
    assert len(found) > 50
    assert np.all(found >= machine.arrays.joint_min)
    assert np.all(found <= machine.arrays.joint_max)
