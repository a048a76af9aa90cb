"""Lattices, against the joints' ranges and the cylinder lengths of postures."""

import itertools

import numpy as np
import pytest

from mhsb_planner.integrated.lattice import (
    NO_POINT,
    find_neighbour,
    is_around,
    lattice_even_in_angles,
    lattice_even_in_lengths,
)


def test_lattices_cover_the_joints_ranges_with_steps_as_asked(machine, posture_within):
    start = posture_within(machine, np.random.default_rng(2))
    limits, links = machine.arrays, machine.arrays.link_length
    for lattice, step in (
        (lattice_even_in_lengths(machine, start, 5e-3), None),
        (lattice_even_in_angles(machine, start, 0.05), 0.05 / np.cumsum(links[::-1])[::-1]),
    ):
        first = (lattice.start // lattice.stride) % lattice.shape
        for j in range(3):
            points = lattice.shape[j]
            angle, length = lattice.angle[j, :points], lattice.length[j, :points]
            assert angle[first[j]] == start[j]
            ends = sorted((angle[0], angle[-1]))
            assert ends == pytest.approx([limits.joint_min[j], limits.joint_max[j]], abs=5e-3)
            postures = (np.where(np.arange(3) == j, q, start) for q in angle)
            lengths = [machine.cylinder_lengths(posture)[j] for posture in postures]
            assert lengths == pytest.approx(length, abs=1e-12)
            if step is None:
                assert np.all(np.diff(length)[1:-1] == pytest.approx(5e-3))
            else:
                assert np.all(np.abs(np.diff(angle)) <= step[j] * 1.06)


def test_each_step_leads_to_the_neighbour_with_its_indices(machine, posture_within):
    lattice = lattice_even_in_angles(
        machine, posture_within(machine, np.random.default_rng(3)), 0.6
    )
    ranges = [range(count) for count in lattice.shape]
    numbers = {point: number for number, point in enumerate(itertools.product(*ranges))}
    for point in numbers:
        for move in lattice.moves:
            expected = numbers.get(tuple(int(i) for i in point + move), NO_POINT)
            assert find_neighbour(lattice, np.array(point), move) == expected


def test_a_point_is_around_the_goals_between_its_neighbours_alone(machine, posture_within):
    random = np.random.default_rng(4)
    lattice = lattice_even_in_lengths(machine, posture_within(machine, random), 22e-3)
    seen = set()
    for _ in range(200):
        at, spread = random.integers(lattice.shape), random.choice([0.4, 1.1])
        goal = np.empty(3)
        within = True
        for j, count in enumerate(lattice.shape):
            place = at[j] + random.uniform(-spread, spread)
            place = min(max(place, 0.0), count - 1.0)
            goal[j] = np.interp(place, np.arange(count), lattice.length[j, :count])
            within = within and abs(place - at[j]) <= 1.0
        assert is_around(lattice, at, goal) == within
        seen.add(within)
    assert seen == {True, False}
