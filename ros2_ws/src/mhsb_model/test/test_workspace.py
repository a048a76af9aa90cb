"""The working region of the tip, against dense sampling."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mhsb_model.machine import load_machine
from mhsb_model.workspace import (
    MOVE_SAMPLES,
    WORKSPACE_TOLERANCE,
    compute_workspace_excess,
    move_stays_in_workspace,
)

postures = st.tuples(st.floats(-0.8, 1.5), st.floats(-2.0, 0.1), st.floats(-2.1, 0.1)).map(np.array)


def excess_along(machine, start, end):
    """Largest excess on the straight joint move, at a thousand instants."""
    m, area = machine.arrays, machine.config.workspace
    angle = np.cumsum(start + np.linspace(0, 1, 1000)[:, None] * (end - start), axis=1)
    x, z = ((m.link_length * part(angle)).sum(axis=1) for part in (np.cos, np.sin))
    radius = np.hypot(x, z)
    return np.max([area.min_x - x, area.min_radius - radius, radius - area.max_radius])


def test_excess_is_the_distance_beyond_the_nearest_border(machine):
    arrays = machine.arrays
    assert math.isclose(compute_workspace_excess(arrays, -0.1, 0.5), 0.1)
    assert math.isclose(compute_workspace_excess(arrays, 0.0, 0.2), 0.05)
    assert math.isclose(compute_workspace_excess(arrays, 0.0, 1.1), 0.071)
    assert compute_workspace_excess(arrays, 0.5, 0.0) < 0.0


@given(postures, postures)
def test_moves_that_leave_the_region_are_found(machine, start, end):
    end = start + 0.2 * (end - start)  # as long as steps of the search are
    at_ends = max(
        compute_workspace_excess(machine.arrays, *machine.tip_position(q)) for q in (start, end)
    )
    beyond = excess_along(machine, start, end) - max(0.0, at_ends)
    if move_stays_in_workspace(machine.arrays, start, end):
        assert beyond < 2e-4
    else:
        assert beyond > 0.0


def stays_at_samples(machine, start, end):
    """Whether the tip stays inside at the samples of a move, by forward kinematics in NumPy."""
    m = machine.arrays

    def excess(q):
        angle = np.cumsum(np.where(m.turns, q, 0.0))
        length = m.link_length + np.where(m.slides, q, 0.0)
        x, z = length @ np.cos(angle), length @ np.sin(angle)
        radius = math.hypot(x, z)
        return max(m.min_x - x, m.min_radius - radius, radius - m.max_radius)

    allowed = max(0.0, excess(start), excess(end)) + WORKSPACE_TOLERANCE
    shares = np.arange(1, MOVE_SAMPLES + 1) / (MOVE_SAMPLES + 1)
    return all(excess(start + share * (end - start)) <= allowed for share in shares)


@pytest.mark.parametrize("name", ["mhsb_arm3", "telescope_arm"])
def test_a_bound_proves_only_moves_that_stay_inside_at_all_samples(name, fresh_seed):
    machine, random = load_machine(name), np.random.default_rng(fresh_seed)
    plane = machine.planar_arm
    a, count = plane.arrays, {True: 0, False: 0}
    for _ in range(2000):
        start, end = random.uniform(a.joint_min, a.joint_max, (2, plane.joint_count))
        end = start + random.choice([0.05, 0.3, 1.0]) * (end - start)
        stays = stays_at_samples(plane, start, end)
        assert move_stays_in_workspace(a, start, end) == stays
        count[stays] += 1
    assert min(count.values()) > 20
