"""Forward kinematics, against complex numbers and finite differences."""

import cmath

import numpy as np
import pytest

from mhsb_model import kinematics

LENGTHS = np.array([0.45, 0.40, 0.179])


@pytest.mark.parametrize("joint_count", [1, 2, 3, 6])
def test_tip_is_the_sum_of_links_as_complex_numbers(joint_count):
    rng = np.random.default_rng(joint_count)
    lengths, q = rng.uniform(0.1, 1, joint_count), rng.uniform(-3, 3, joint_count)
    tip = sum(
        length * cmath.exp(1j * angle) for length, angle in zip(lengths, np.cumsum(q), strict=True)
    )
    assert kinematics.tip_position(lengths, q) == pytest.approx((tip.real, tip.imag), abs=1e-14)
    assert kinematics.joint_positions(lengths, q)[-1] == pytest.approx((tip.real, tip.imag))


@pytest.mark.parametrize("joint_count", [1, 3, 6])
def test_jacobian_is_the_derivative_of_the_tip(joint_count):
    rng = np.random.default_rng(joint_count)
    lengths, q = rng.uniform(0.1, 1, joint_count), rng.uniform(-3, 3, joint_count)
    jacobian = kinematics.tip_jacobian(lengths, q)
    h = 1e-6
    for j, step in enumerate(h * np.eye(joint_count)):
        ahead = np.array(kinematics.tip_position(lengths, q + step))
        behind = np.array(kinematics.tip_position(lengths, q - step))
        assert jacobian[:, j] == pytest.approx((ahead - behind) / (2 * h), abs=1e-9)


def test_all_angles_positive_raise_the_tip():
    assert kinematics.tip_position(LENGTHS, np.array([0.3, 0.0, 0.0]))[1] > 0.0
