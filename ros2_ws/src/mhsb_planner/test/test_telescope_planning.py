"""Planning for an arm whose second boom extends."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mhsb_model.files.config_files import find_config_file
from mhsb_model.inverse_kinematics.tip_postures import (
    find_closing_joints,
    find_closure_side,
    solve_posture,
)
from mhsb_model.kinematics import tip_position
from mhsb_model.linkages.linkage import cylinder_length
from mhsb_model.machine import Machine, load_machine
from mhsb_model.types import frozen
from mhsb_planner.integrated.goal_postures import sample_goal_postures
from mhsb_planner.integrated.lower_bound import enclose_cell
from mhsb_planner.posture.s1_global_search import find_postures_at
from mhsb_planner.posture.s1_slsqp import find_largest_polytope_by_slsqp

GOAL = (0.75, 0.45)


@pytest.fixture(scope="module")
def arm() -> Machine:
    return load_machine(find_config_file("telescope_arm.yaml"))


def chain(arm: Machine, kinds: str):
    """Arrays of the arm's cylinders on another chain of joints that turn (R) and slide (P)."""
    like = [2 if kind == "P" else min(k, 1) for k, kind in enumerate(kinds)]
    slides = np.array([kind == "P" for kind in kinds])
    return arm.arrays._replace(
        turns=frozen(~slides),
        slides=frozen(slides),
        link_length=frozen(np.linspace(0.45, 0.1, len(kinds))),
        joint_min=frozen(arm.arrays.joint_min[like]),
        joint_max=frozen(arm.arrays.joint_max[like]),
        linkage=frozen(arm.arrays.linkage[like]),
    )


def test_no_slsqp_start_finds_a_larger_polytope(arm):
    random = np.random.default_rng(11)
    for _ in range(6):
        x, z = random.uniform((0.2, -0.6), (0.8, 0.6))
        p = int(random.integers(len(arm.patterns)))
        found = find_postures_at(arm, x, z)
        judged = find_largest_polytope_by_slsqp(arm, x, z, arm.patterns[p], seed=1, starts=10)
        assert judged is not None
        assert found.area[p] >= judged[1] * (1.0 - 1e-6)
        assert arm.tip_position(found.posture[p]) == pytest.approx((x, z), abs=1e-9)


def test_goal_postures_have_their_tip_at_the_goal(arm):
    middle = arm.end_link_angle(find_postures_at(arm, *GOAL).posture[0])
    for psi in (None, (middle - 0.1, middle + 0.1)):
        goals = sample_goal_postures(arm, *GOAL, psi)
        assert len(goals.posture) > 5
        for q in goals.posture:
            assert arm.tip_position(q) == pytest.approx(GOAL, abs=1e-9)
            assert np.all(arm.arrays.joint_min <= q)
            assert np.all(q <= arm.arrays.joint_max)
            assert psi is None or psi[0] - 1e-9 <= arm.end_link_angle(q) <= psi[1] + 1e-9


@given(
    kinds=st.sampled_from(["RRP", "RPR", "RRRP", "RPRR", "RPRP", "RPRRP"]),
    seed=st.integers(0, 10_000),
    width=st.floats(0.0, 0.6),
)
def test_a_cell_encloses_all_its_postures(arm, kinds, seed, width):
    arrays, random = chain(arm, kinds), np.random.default_rng(seed)
    i, j = find_closing_joints(arrays)
    held = [k for k in range(len(kinds)) if k not in (i, j)]
    q = random.uniform(arrays.joint_min, arrays.joint_max)
    tip, side = tip_position(arrays, q), find_closure_side(arrays, q, i, j)
    share = random.uniform(size=len(held))
    size = width * (arrays.joint_max - arrays.joint_min)[held]
    cell = np.column_stack([q[held] - share * size, q[held] + (1.0 - share) * size])
    box, other = np.empty((2, len(kinds))), np.empty(len(kinds))
    assert enclose_cell(arrays, tip, side, cell, box)
    for free in [q[held], *random.uniform(cell[:, 0], cell[:, 1], (100, len(held)))]:
        if solve_posture(arrays, *tip, free, side, other):
            length = [cylinder_length(arrays.linkage[k], other[k]) for k in range(len(kinds))]
            assert np.all(box[0] - 1e-7 <= length)
            assert np.all(length <= box[1] + 1e-7)
