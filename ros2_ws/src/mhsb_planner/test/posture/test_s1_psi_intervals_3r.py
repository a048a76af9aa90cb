"""Feasible intervals of the end-link angle, against a scan."""

import numpy as np
import pytest

from mhsb_model.inverse_kinematics.closed_form_3r import is_within_limits, solve_last_three_joints
from mhsb_model.machine import Machine
from mhsb_planner.posture.s1_psi_intervals_3r import (
    MAX_INTERVALS,
    find_feasible_intervals,
    solve_posture_at_psi,
)

TURN = 2 * np.pi
SCAN = np.linspace(-np.pi, np.pi, 3001)


def intervals(machine, x, z):
    found = np.empty((MAX_INTERVALS, 3))
    return found[: find_feasible_intervals(machine.arrays, x, z, found)]


def is_feasible(machine, x, z, psi, elbow):
    q = np.empty(3)
    return solve_last_three_joints(machine.arrays, x, z, psi, elbow, q) and is_within_limits(
        machine.arrays, q
    )


def distance_to_intervals(found, elbow, psi):
    """Distance of each ψ from the nearest end of the branch's intervals; negative inside."""
    least = np.full(np.shape(psi), np.inf)
    for branch, lower, upper in found:
        if branch == elbow:
            middle, half = (lower + upper) / 2, (upper - lower) / 2
            offset = (psi - middle + np.pi) % TURN - np.pi
            least = np.minimum(least, np.abs(offset) - half)
    return least


def random_points(count):
    rng = np.random.default_rng(5)
    while count:
        x, z = rng.uniform(0, 1.03), rng.uniform(-1.03, 1.03)
        if 0.25 <= np.hypot(x, z) <= 1.029:
            count -= 1
            yield x, z


def wide_machine(machine):
    """The arm with joints that turn almost all the way, as no slider-crank lets them."""
    arrays = machine.arrays._replace(
        joint_min=np.array([-3.0, -3.1, -2.9]), joint_max=np.array([3.0, 3.1, 2.9])
    )
    for limits in (arrays.joint_min, arrays.joint_max):
        limits.setflags(write=False)
    return Machine(machine.config, arrays)


@pytest.mark.parametrize("wide", [False, True])
def test_a_scan_finds_the_same_angles_feasible(machine, wide):
    arm = wide_machine(machine) if wide else machine
    for x, z in random_points(25):
        found = intervals(arm, x, z)
        for elbow in (-1, 1):
            for psi, outside in zip(SCAN, distance_to_intervals(found, elbow, SCAN), strict=True):
                if abs(outside) > 1e-9:
                    assert is_feasible(arm, x, z, psi, elbow) == (outside < 0)


def test_interval_ends_are_feasible_and_the_angles_just_beyond_are_not(machine):
    q = np.empty(3)
    for x, z in random_points(200):
        for elbow, lower, upper in intervals(machine, x, z):
            for end, outwards in ((lower, -1e-7), (upper, 1e-7)):
                assert solve_posture_at_psi(machine.arrays, x, z, end, int(elbow), q)
                joined = distance_to_intervals(intervals(machine, x, z), elbow, end + outwards) < 0
                assert joined or not solve_posture_at_psi(
                    machine.arrays, x, z, end + outwards, int(elbow), q
                )


def test_the_arm_straight_out_is_one_point(slider_crank_machine):
    machine = slider_crank_machine
    reach = sum(machine.arrays.link_length)
    found = intervals(machine, reach, 0.0)
    assert len(found) >= 1
    assert found[:, 1:] == pytest.approx(0.0, abs=1e-5)


def test_beyond_the_reach_there_is_nothing(machine):
    assert len(intervals(machine, 1.2, 0.0)) == 0
