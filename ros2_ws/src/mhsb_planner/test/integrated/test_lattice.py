"""The lattice search, against SciPy's Dijkstra over all its points and patterns."""

import itertools
import math

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from mhsb_model.workspace import node_set_excess
from mhsb_planner.deadline import Deadline
from mhsb_planner.integrated.certificate import least_cost_to
from mhsb_planner.integrated.goal_postures import GoalPostures
from mhsb_planner.integrated.lattice import LatticeSearch, lattice_around
from mhsb_planner.integrated.route import new_memory
from mhsb_planner.search.s2_step import describe, step_costs

SPACING = 6e-3
MARGIN = 1
SWITCH = 2.0


def problems(machine, posture_within, count):
    """Starts, and goal postures some lattice steps away and off the lattice."""
    random = np.random.default_rng(1)
    while count:
        start = posture_within(machine, random)
        lengths = lattice_around(
            machine, start, machine.cylinder_lengths(start)[None, :], SPACING, 3
        )
        if lengths.shape.min() < 5:
            continue
        middle = (lengths.start // lengths.stride) % lengths.shape
        goal = np.array(
            [lengths.angle[j, middle[j] + step] for j, step in enumerate((2, -2, 1))]
        ) + random.uniform(-0.02, 0.02, 3)
        limits = machine.arrays
        if np.all(goal > limits.joint_min) and np.all(goal < limits.joint_max):
            count -= 1
            yield start, np.clip(goal, limits.joint_min, limits.joint_max)


def by_dijkstra(machine, lattice, goal):
    """Least cost to the goal over the whole lattice, from step costs; NNN is in force."""
    patterns = machine.patterns
    points = list(itertools.product(*(range(count) for count in lattice.shape)))
    posture = [np.array([lattice.angle[j, i] for j, i in enumerate(p)]) for p in points]
    place = {p: k for k, p in enumerate(points)}
    count = len(patterns)
    switches = np.count_nonzero(patterns[:, None] != patterns[None], axis=2)
    sink, source = len(points) * count, len(points) * count + 1
    rows, columns, costs = [], [], []

    def add(k, target, states):
        if outside(machine, target) > max(1e-9, outside(machine, posture[k])):
            return
        step = step_costs(machine, posture[k], target)
        for p in np.flatnonzero(step.admissible):
            cost = 0.5 * step.energy[p] + step.duration[p]
            for own in range(count):
                rows.append(k * count + own)
                columns.append(states[p])
                costs.append(cost + SWITCH * switches[own, p])
            if k == lattice.start:
                rows.append(source)
                columns.append(states[p])
                costs.append(cost + SWITCH * switches[0, p])

    for k, p in enumerate(points):
        for move in lattice.moves:
            neighbor = place.get(tuple(int(i) for i in p + move))
            if neighbor is not None:
                add(k, posture[neighbor], neighbor * count + np.arange(count))
        off = machine.cylinder_lengths(posture[k]) - machine.cylinder_lengths(goal)
        if np.max(np.abs(off)) <= SPACING:
            add(k, goal, np.full(count, sink))
    best = {}
    for row, column, cost in zip(rows, columns, costs, strict=True):
        best[row, column] = min(cost, best.get((row, column), math.inf))
    ends = np.array(list(best)).T
    matrix = csr_array((list(best.values()), (ends[0], ends[1])), shape=(source + 1,) * 2)
    return float(dijkstra(matrix, indices=source)[sink])


def outside(machine, q):
    return node_set_excess(machine.arrays, *machine.tip_position(q))


def test_the_search_finds_what_dijkstra_finds_and_nothing_undercuts_the_bound(
    machine, terms_of, posture_within
):
    t = terms_of(machine, weights=(0.5, 1.0, SWITCH))
    found = 0
    for start, goal in problems(machine, posture_within, 3):
        goals = describe(machine.arrays, goal[None, :])
        searching = LatticeSearch(t, new_memory(t), machine, start, goals, SPACING, MARGIN)
        route = searching.search(math.inf, 10**6)
        lengths = np.vstack([machine.cylinder_lengths(start), goals.length])
        lattice = lattice_around(machine, start, lengths, SPACING, MARGIN)
        expected = by_dijkstra(machine, lattice, goal)
        if route is None:
            assert expected == math.inf
            continue
        assert searching.cost == pytest.approx(expected, rel=1e-9)
        via, reached = route
        assert reached == 0
        assert via[0] == pytest.approx(machine.cylinder_lengths(start))
        assert via[-1] == pytest.approx(machine.cylinder_lengths(goal))
        tip = machine.tip_position(goal)
        exactly = GoalPostures((tip[0], tip[1]), goals, np.ones(1), np.array([goal.sum()]), True)
        bound = least_cost_to(machine, t.circuit, via[0], exactly, np.array([0.5, 1.0]))
        assert bound <= expected * (1 + 1e-9)
        found += 1
    assert found >= 2


def test_nothing_is_found_that_costs_as_much_as_is_known_already(
    machine, terms_of, posture_within
):
    t = terms_of(machine)
    start, goal = next(problems(machine, posture_within, 1))
    goals = describe(machine.arrays, goal[None, :])

    def searching():
        return LatticeSearch(t, new_memory(t), machine, start, goals, SPACING, MARGIN)

    best = searching()
    assert best.search(math.inf, 10**6) is not None
    assert searching().search(best.cost * (1 - 1e-9), 10**6) is None
    assert searching().search(best.cost * (1 + 1e-9), 10**6) is not None


def test_a_search_stops_when_it_is_late_or_has_expanded_enough(machine, terms_of, posture_within):
    t = terms_of(machine)
    start, goal = next(problems(machine, posture_within, 1))
    goals = describe(machine.arrays, goal[None, :])
    late = LatticeSearch(t, new_memory(t), machine, start, goals, SPACING, MARGIN)
    assert late.search(math.inf, 10**6, Deadline.after(-1.0)) is None
    assert late.expanded == 0
    short = LatticeSearch(t, new_memory(t), machine, start, goals, SPACING, MARGIN)
    assert short.search(math.inf, 2) is None
    assert short.expanded == 2
