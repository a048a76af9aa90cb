"""Postures at a tip position of chains with four joints, against MuJoCo and SciPy."""

import math

import mujoco
import numpy as np
import pytest
from scipy.optimize import fsolve

from mhsb_model.files.config_files import find_config_file
from mhsb_model.inverse_kinematics import tip_postures
from mhsb_model.inverse_kinematics.closed_form_3r import is_within_limits
from mhsb_model.machine import load_machine

PAIRS = [(i, j) for i in range(4) for j in range(i + 1, 4)]


@pytest.fixture(scope="module")
def arm():
    return load_machine(find_config_file("mhsb_arm4.yaml"))


@pytest.fixture(scope="module")
def chain(arm):
    """The bare chain in MuJoCo, hinges about −y so that angles are counter-clockwise in x, z."""
    spec, body, at = mujoco.MjSpec(), None, 0.0
    for length in arm.arrays.link_length:
        parent = spec.worldbody if body is None else body
        body = parent.add_body(pos=[at, 0.0, 0.0], mass=1.0, inertia=[1.0] * 3, ipos=[0.0] * 3)
        body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0.0, -1.0, 0.0])
        at = length
    body.add_site(name="tip", pos=[at, 0.0, 0.0])
    model = spec.compile()
    return model, mujoco.MjData(model)


def tip_in_mujoco(chain, q):
    model, data = chain
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    return data.site("tip").xpos[[0, 2]]


def random_postures(arm, count, seed):
    low, high = arm.arrays.joint_min, arm.arrays.joint_max
    return np.random.default_rng(seed).uniform(low, high, (count, 4))


def test_every_posture_found_has_its_tip_at_the_point_and_its_end_link_as_asked(arm, chain):
    psi = np.linspace(-math.pi, math.pi, 600)
    found = arm.postures(0.7, 0.2, psi)
    assert len(found) > 200
    for q in found:
        assert tip_in_mujoco(chain, q) == pytest.approx((0.7, 0.2), abs=1e-12)
        assert is_within_limits(arm.arrays, q)
        assert np.abs(np.angle(np.exp(1j * (q.sum() - psi)))).min() < 1e-9


def test_the_free_angles_of_any_posture_lead_back_to_it(arm, chain):
    q = np.empty(4)
    for posture in random_postures(arm, 200, seed=1):
        x, z = tip_in_mujoco(chain, posture)
        free = np.array([posture[0], posture.sum()])
        elbow = 1 if posture[2] > 0.0 else -1
        assert tip_postures.solve_posture(arm.arrays, x, z, free, elbow, q)
        assert q == pytest.approx(posture, abs=1e-7)


@pytest.mark.parametrize(("i", "j"), PAIRS)
def test_two_joints_close_the_chain_as_a_root_finder_has_it(arm, i, j):
    for posture in random_postures(arm, 25, seed=2):
        x, z = arm.tip_position(posture)
        side = tip_postures.find_closure_side(arm.arrays, posture, i, j)
        found = posture.copy()
        found[[i, j]] = 0.0
        assert tip_postures.close_chain(arm.arrays, x, z, i, j, side, found)
        assert found == pytest.approx(posture, abs=1e-6)

        def miss(pair, posture=posture, tip=(x, z)):
            q = posture.copy()
            q[[i, j]] = pair
            return arm.tip_position(q) - tip

        root = fsolve(miss, posture[[i, j]] + 0.01, xtol=1e-12)
        both = []
        for other in (-1, 1):
            q = posture.copy()
            assert tip_postures.close_chain(arm.arrays, x, z, i, j, other, q)
            both.append(np.abs(np.angle(np.exp(1j * (q[[i, j]] - root)))).max())
        assert min(both) < 1e-5


def test_a_tip_out_of_reach_is_not_closed(arm):
    q = np.zeros(4)
    assert not tip_postures.close_chain(arm.arrays, 1.3, 0.0, 0, 1, 1, q)


def test_a_posture_moved_a_little_is_led_back_to_the_point_and_within_limits(arm, chain):
    random, q = np.random.default_rng(3), np.empty(4)
    for posture in random_postures(arm, 100, seed=4):
        x, z = tip_in_mujoco(chain, posture)
        near = posture + random.uniform(-1e-3, 1e-3, 4)
        assert tip_postures.find_nearest_posture(arm.arrays, x, z, near, q)
        assert is_within_limits(arm.arrays, q)
        assert tip_in_mujoco(chain, q) == pytest.approx((x, z), abs=1e-9)
        assert np.abs(q - near).max() < 0.2


def test_where_nothing_reaches_nothing_is_nearest(arm):
    assert not tip_postures.find_nearest_posture(arm.arrays, 1.3, 0.0, np.zeros(4), np.empty(4))
