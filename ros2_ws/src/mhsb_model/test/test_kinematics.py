"""Forward kinematics, against complex numbers and finite differences."""

import cmath

import numpy as np
import pytest

from mhsb_model import kinematics
from mhsb_model.types import frozen

KINDS = ["R", "RR", "RRR", "RRP", "RPR", "RRRRRR", "RPRRPR"]
"""Chains of joints that turn (R) and slide (P)."""


def random_chain(machine, kinds):
    """Arrays of such a chain, and a posture."""
    rng = np.random.default_rng(len(kinds))
    arrays = machine.arrays._replace(
        turns=frozen(np.array([kind == "R" for kind in kinds])),
        slides=frozen(np.array([kind == "P" for kind in kinds])),
        link_length=frozen(rng.uniform(0.1, 1, len(kinds))),
    )
    return arrays, np.where(arrays.slides, 0.1, rng.uniform(-3, 3, len(kinds)))


@pytest.mark.parametrize("kinds", KINDS)
def test_tip_is_the_sum_of_links_as_complex_numbers(machine, kinds):
    arrays, q = random_chain(machine, kinds)
    tip, angle = 0.0j, 0.0
    for slides, length, at in zip(arrays.slides, arrays.link_length, q, strict=True):
        angle += 0.0 if slides else at
        tip += (length + at if slides else length) * cmath.exp(1j * angle)
    here = (tip.real, tip.imag)
    assert kinematics.tip_position(arrays, q) == pytest.approx(here, abs=1e-14)
    assert kinematics.joint_positions(arrays, q)[-1] == pytest.approx(here)
    assert kinematics.end_link_angle(arrays, q) == pytest.approx(angle)


@pytest.mark.parametrize("kinds", KINDS)
def test_jacobian_is_the_derivative_of_the_tip(machine, kinds):
    arrays, q = random_chain(machine, kinds)
    jacobian = kinematics.tip_jacobian(arrays, q)
    h = 1e-6
    for j, step in enumerate(h * np.eye(len(q))):
        ahead = np.array(kinematics.tip_position(arrays, q + step))
        behind = np.array(kinematics.tip_position(arrays, q - step))
        assert jacobian[:, j] == pytest.approx((ahead - behind) / (2 * h), abs=1e-9)


@pytest.mark.parametrize("kinds", KINDS)
def test_no_point_of_a_link_moves_farther_than_told(machine, kinds):
    arrays, start = random_chain(machine, kinds)
    end = start + np.random.default_rng(3).uniform(-0.2, 0.2, len(kinds))
    turn, farthest = 0.0, 0.0
    for j in range(len(kinds)):
        turn += kinematics.get_turn_angle(arrays.turns, end - start, j)
        farthest += kinematics.bound_displacement(arrays, start, end, turn, j)
    ways = (start + share * (end - start) for share in np.linspace(0.0, 1.0, 50))
    tips = np.array([kinematics.tip_position(arrays, q) for q in ways])
    assert np.hypot(*np.diff(tips, axis=0).T).sum() <= farthest


def test_all_angles_positive_raise_the_tip(machine):
    assert kinematics.tip_position(machine.arrays, np.array([0.3, 0.0, 0.0]))[1] > 0.0
