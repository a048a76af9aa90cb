"""Kinematics of chains with telescopes, against complex numbers and finite differences."""

import cmath

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mhsb_model.machine import Machine
from mhsb_model.telescopes import telescope_kinematics as telescopes
from mhsb_model.types import FloatArray

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
def test_postures_at_a_tip_are_within_limits_and_put_the_tip_there(
    telescope_machine, share
):
    q = posture(telescope_machine, share)
    found = telescope_machine.postures(*telescope_machine.tip_position(q), np.zeros(1))
    arrays = telescope_machine.arrays
    assert np.all(found >= arrays.joint_min)
    assert np.all(found <= arrays.joint_max)
    for each in found:
        assert telescope_machine.tip_position(each) == pytest.approx(
            telescope_machine.tip_position(q), abs=1e-9
        )


def test_extensions_are_sampled_from_end_to_end(telescope_machine):
    arrays = telescope_machine.arrays
    samples = telescopes.extension_samples(arrays, telescope_machine.slides, 5)
    assert samples[:, 0] == pytest.approx([0.0, 0.0625, 0.125, 0.1875, 0.25])


def test_a_posture_with_a_sampled_extension_is_found_again(telescope_machine):
    for out in (0.0, 0.25):
        q = np.array([0.8, -1.2, out])
        found = telescope_machine.postures(*telescope_machine.tip_position(q), np.zeros(1))
        assert np.abs(found - q).max(axis=1).min() < 1e-9


def test_a_telescope_between_turning_joints_lengthens_the_link_before(telescope_machine):
    slides, extension = (False, True, False), np.array([0.1])
    held = telescopes.with_extensions_held(telescope_machine.arrays, slides, extension)
    l1, l2, l3 = telescope_machine.arrays.link_length
    assert held.link_length == pytest.approx([l1 + l2 + 0.1, l3])
    again = telescopes.with_extensions(slides, np.array([[0.3, 0.4]]), extension)
    assert again.tolist() == [[0.3, 0.1, 0.4]]
