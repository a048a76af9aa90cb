"""Chains with telescopes: tip, Jacobian and postures, against complex numbers, finite differences
and the forward kinematics."""

import cmath
import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mhsb_model import kinematics
from mhsb_model.inverse_kinematics.telescope_postures import (
    find_telescope_postures,
    hold_extensions,
    sample_extensions,
)
from mhsb_model.inverse_kinematics.tip_postures import close_chain, find_closure_side
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray, frozen

shares = st.tuples(*[st.floats(0.0, 1.0)] * 3).map(np.array)


def posture(machine: Machine, share: FloatArray) -> FloatArray:
    lower, upper = machine.arrays.joint_min, machine.arrays.joint_max
    return lower + share * (upper - lower)


@given(shares)
def test_the_tip_is_the_sum_of_links_of_which_the_last_is_longer_by_its_extension(
    telescope_machine, share
):
    q1, q2, out = posture(telescope_machine, share)
    l1, l2, l3 = telescope_machine.arrays.link_length
    tip = l1 * cmath.exp(1j * q1) + (l2 + l3 + out) * cmath.exp(1j * (q1 + q2))
    at = telescope_machine.tip_position(np.array([q1, q2, out]))
    assert at == pytest.approx((tip.real, tip.imag), abs=1e-14)


@given(shares)
def test_the_jacobian_is_the_derivative_of_the_tip(telescope_machine, share):
    q, h = posture(telescope_machine, share), 1e-6
    jacobian = telescope_machine.jacobian(q)
    for j, step in enumerate(h * np.eye(3)):
        change = telescope_machine.tip_position(q + step) - telescope_machine.tip_position(q - step)
        assert jacobian[:, j] == pytest.approx(change / (2 * h), abs=1e-9)


@given(shares)
def test_postures_at_a_tip_are_within_limits_and_put_the_tip_there(telescope_machine, share):
    q = posture(telescope_machine, 1e-6 + (1.0 - 2e-6) * share)  # by rounding off the limits
    psi = telescope_machine.end_link_angle(q)
    angles = np.array([psi, psi + 0.1])
    found = telescope_machine.postures(*telescope_machine.tip_position(q), angles)
    arrays = telescope_machine.arrays
    assert np.abs(found - q).max(axis=1).min() < 1e-6
    assert np.all(found >= arrays.joint_min)
    assert np.all(found <= arrays.joint_max)
    for each in found:
        assert telescope_machine.tip_position(each) == pytest.approx(
            telescope_machine.tip_position(q), abs=1e-9
        )


def test_extensions_are_sampled_from_end_to_end(telescope_machine):
    samples = sample_extensions(telescope_machine.arrays, np.array([2]), 5)
    assert samples[:, 0] == pytest.approx([0.0, 0.0625, 0.125, 0.1875, 0.25])


@pytest.mark.parametrize("kinds", ["RRP", "RPR", "RPRP", "RRPR", "RRRP"])
def test_a_posture_is_among_those_with_its_end_link_angle(telescope_machine, kinds):
    slides = np.array([kind == "P" for kind in kinds])
    arrays = telescope_machine.arrays._replace(
        turns=frozen(~slides),
        slides=frozen(slides),
        link_length=frozen(np.linspace(0.4, 0.1, len(kinds))),
        joint_min=frozen(np.where(slides, 0.0, -2.5)),
        joint_max=frozen(np.where(slides, 0.23, 2.5)),
    )
    random = np.random.default_rng(6)
    for q in random.uniform(arrays.joint_min, arrays.joint_max, (50, len(kinds))):
        q[slides] = np.clip(np.round(q[slides], 2), 0.01, 0.22)  # extensions that are sampled
        psi = np.array([kinematics.end_link_angle(arrays, q)])
        found = find_telescope_postures(arrays, *kinematics.tip_position(arrays, q), psi)
        assert np.abs(found - q).max(axis=1).min() < 1e-6


def test_a_telescope_between_turning_joints_lengthens_the_link_before(telescope_machine):
    arrays = telescope_machine.arrays._replace(
        turns=np.array([True, False, True]), slides=np.array([False, True, False])
    )
    held = hold_extensions(arrays, np.array([0.1]))
    l1, l2, l3 = telescope_machine.arrays.link_length
    assert held.link_length == pytest.approx([l1 + l2 + 0.1, l3])
    assert held.slides.tolist() == [False, False]


@pytest.fixture(scope="module")
def chain(telescope_machine):
    """Two booms with a telescope each and a jib: turns, turns, slides, turns, slides."""
    kinds = [False, False, True, False, True]
    return telescope_machine.arrays._replace(
        turns=frozen(~np.array(kinds)),
        slides=frozen(np.array(kinds)),
        link_length=frozen(np.array([0.4, 0.3, 0.05, 0.2, 0.02])),
        joint_min=frozen(np.where(kinds, 0.0, -2.5)),
        joint_max=frozen(np.where(kinds, 0.3, 2.5)),
    )


@pytest.mark.parametrize(("i", "j"), list(itertools.combinations(range(5), 2)))
def test_any_two_joints_close_the_chain_on_the_side_on_which_they_did(chain, i, j):
    random = np.random.default_rng(5)
    for q in random.uniform(chain.joint_min, chain.joint_max, (200, 5)):
        x, z = kinematics.tip_position(chain, q)
        side = find_closure_side(chain, q, i, j)
        found = q.copy()
        found[[i, j]] = 0.17
        assert close_chain(chain, x, z, i, j, side, found)
        assert found == pytest.approx(q, abs=1e-5)
        found[[i, j]] = 0.17
        if close_chain(chain, x, z, i, j, -side, found):  # the other solution
            assert kinematics.tip_position(chain, found) == pytest.approx((x, z), abs=1e-9)


def test_what_telescopes_do_not_reach_is_not_closed(chain):
    q = np.array([0.0, 0.0, 0.1, 0.0, 0.1])
    assert not close_chain(chain, 0.0, 0.9, 2, 3, 1, q.copy())
    assert not close_chain(chain, 0.5, 0.0, 2, 4, 1, q.copy())  # both along one line
