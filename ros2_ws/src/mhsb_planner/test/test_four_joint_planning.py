"""Planning for the arm with four joints, whose postures at a point have two free angles."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mhsb_model.files.config_files import find_config_file
from mhsb_model.inverse_kinematics.tip_postures import solve_posture
from mhsb_model.machine import Machine, load_machine
from mhsb_planner.errors import RequestError
from mhsb_planner.integrated.goal_postures import sample_goal_postures
from mhsb_planner.integrated.lower_bound import enclose_cell
from mhsb_planner.search.fixed_j3 import compute_fixed_j3_posture, find_elbow_side, read_kept_angles

GOAL = (0.60, 0.55)


@pytest.fixture(scope="module")
def arm() -> Machine:
    return load_machine(find_config_file("mhsb_arm4.yaml"))


def random_postures(arm, count, seed):
    low, high = arm.arrays.joint_min, arm.arrays.joint_max
    return np.random.default_rng(seed).uniform(low, high, (count, 4))


def test_goal_postures_have_their_tip_at_the_goal_and_psi_as_asked(arm):
    for psi in (None, -1.0, (-1.2, -0.9)):
        goals = sample_goal_postures(arm, *GOAL, psi)
        angles = goals.posture
        assert len(angles) > 10
        for q in angles:
            assert arm.tip_position(q) == pytest.approx(GOAL, abs=1e-9)
        assert np.all(angles >= arm.arrays.joint_min)
        assert np.all(angles <= arm.arrays.joint_max)
        turns = (goals.free[:, -1] - angles.sum(axis=1)) / (2 * np.pi)
        assert turns == pytest.approx(np.round(turns), abs=1e-9)
        if psi is not None:
            low, high = np.min(psi), np.max(psi)
            off = np.abs(np.angle(np.exp(1j * (goals.free[:, -1] - (low + high) / 2))))
            assert off.max() <= (high - low) / 2 + 1e-9


def test_a_cell_of_free_angles_encloses_all_its_postures(arm):
    random, box = np.random.default_rng(7), np.empty((2, 4))
    for q in random_postures(arm, 300, seed=8):
        tip = tuple(arm.tip_position(q))
        width = random.uniform(0.0, [0.5, 1.0]) ** 2
        share = random.uniform(0.0, 1.0, 2)
        free = np.array([q[0], q.sum()])
        cell = np.column_stack([free - share * width, free + (1 - share) * width])
        assert enclose_cell(arm.arrays, tip, 1 if q[2] > 0 else -1, cell, box)
        length = arm.cylinder_lengths(q)
        assert np.all(box[0] - 1e-9 <= length)
        assert np.all(length <= box[1] + 1e-9)


@given(
    low=st.floats(-7.0, 7.0),
    inner=st.floats(-1.6, 2.4),
    widths=st.tuples(st.floats(1e-6, 0.4), st.floats(1e-6, 1.0)),
    beyond=st.floats(0.0, 0.3),
    direction=st.floats(-3.1, 3.1),
    elbow=st.sampled_from([-1, 1]),
)
def test_cells_of_a_chain_enclose_its_postures_also_where_the_tip_is_close_to_a_joint(
    arm, low, inner, widths, beyond, direction, elbow
):
    length = arm.arrays.link_length
    tip = (
        length[0] * np.cos(inner) + beyond * np.cos(direction),
        length[0] * np.sin(inner) + beyond * np.sin(direction),
    )
    cell = np.array([[inner - widths[0], inner + widths[0]], [low, low + widths[1]]])
    box, q = np.empty((2, 4)), np.empty(4)
    some = enclose_cell(arm.arrays, tip, elbow, cell, box)
    for share in np.random.default_rng(0).uniform(size=(200, 2)):
        free = cell[:, 0] + share * (cell[:, 1] - cell[:, 0])
        if solve_posture(arm.arrays, *tip, free, elbow, q):
            lengths = arm.cylinder_lengths(q)
            assert some
            assert np.all(box[0] - 1e-7 <= lengths)
            assert np.all(lengths <= box[1] + 1e-7)


def test_the_fixed_planner_keeps_two_joints_where_it_can(arm):
    kept = 0
    for q in random_postures(arm, 100, seed=10):
        x, z = arm.tip_position(q)
        found = compute_fixed_j3_posture(
            arm, x, z, read_kept_angles(arm, q), find_elbow_side(arm, q)
        )
        assert found == pytest.approx(q, abs=1e-6)
        kept += bool(np.all(found[2:] == q[2:]))
    assert kept == 100


def test_of_two_kept_joints_one_initial_angle_is_refused(arm):
    with pytest.raises(RequestError, match="is of one joint, 2 are kept"):
        compute_fixed_j3_posture(arm, *GOAL, -1.0)
