"""The lattice search, against SciPy's Dijkstra over all its points and patterns."""

import itertools
import math

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from mhsb_model.holding import MAX_HELD_SPEED, choose_holding_modes
from mhsb_model.types import frozen
from mhsb_model.workspace import compute_workspace_excess
from mhsb_planner.deadline import Deadline
from mhsb_planner.integrated import lattice_search
from mhsb_planner.integrated.cylinder_path import new_path_cost_buffers
from mhsb_planner.integrated.goal_postures import GoalPostures
from mhsb_planner.integrated.lattice import lattice_even_in_angles, lattice_even_in_lengths
from mhsb_planner.integrated.lattice_search import LatticeSearch
from mhsb_planner.integrated.lower_bound import bound_cost_to_goals
from mhsb_planner.search.s2_step import compute_step_costs, describe_postures

SPACING, REACH = 22e-3, 0.4  # m
SWITCH = 2.0


def long_steps(machine, start):
    return lattice_even_in_lengths(machine, start, SPACING)


def wide_turns(machine, start):
    return lattice_even_in_angles(machine, start, REACH)


def problems(machine, posture_within, count):
    """Starts, and goal postures some lattice steps away and off the lattice."""
    random = np.random.default_rng(1)
    while count:
        start = posture_within(machine, random)
        lattice = long_steps(machine, start)
        middle = (lattice.start // lattice.stride) % lattice.shape
        steps = np.where(middle >= 2, -2, 1)
        goal = np.array([lattice.angle[j, middle[j] + step] for j, step in enumerate(steps)])
        goal = goal + random.uniform(-0.02, 0.02, 3)
        if outside(machine, goal) < 0.0:
            count -= 1
            yield start, np.clip(goal, machine.arrays.joint_min, machine.arrays.joint_max)


def goal_at(machine, goal):
    """Return the description of a posture that is the only goal."""
    return describe_postures(machine.arrays, goal[None, :])


def by_dijkstra(machine, lattice, goal):
    """Least cost to the goal over the whole lattice, from step costs; NNN is in force.

    A vertex for each posture in each pattern as it is reached, and another one as it is left:
    between these two lie the switches, from there to the next posture the step.
    """
    patterns = machine.patterns
    points = list(itertools.product(*(range(count) for count in lattice.shape)))
    posture = [np.array([lattice.angle[j, i] for j, i in enumerate(p)]) for p in points]
    excess = [outside(machine, q) for q in posture]
    place = {p: k for k, p in enumerate(points)}
    count, own = len(patterns), np.arange(len(patterns))
    leaving, sink = len(points) * count, 2 * len(points) * count
    source = int(lattice.start) * count + int(np.flatnonzero(~patterns.any(axis=1))[0])
    switches = np.count_nonzero(patterns[:, None] != patterns[None], axis=2)
    to_hold = np.count_nonzero(
        patterns != choose_holding_modes(machine, machine.piston_forces(goal)), axis=1
    )
    edges = []

    def add(k, target, beyond, states, last_switches):
        if beyond > max(1e-9, excess[k]):
            return
        step = compute_step_costs(machine, posture[k], target, MAX_HELD_SPEED)
        cost = 0.5 * step.energy + step.duration + SWITCH * last_switches
        ways = np.column_stack([leaving + k * count + own, states, cost])
        edges.append(ways[step.admissible])

    for k, p in enumerate(points):
        reached, left = np.repeat(own, count), np.tile(own, count)
        between = [k * count + reached, leaving + k * count + left, SWITCH * switches.ravel()]
        edges.append(np.column_stack(between))
        for move in lattice.moves:
            neighbor = place.get(tuple(int(i) for i in p + move))
            if neighbor is not None:
                add(k, posture[neighbor], excess[neighbor], neighbor * count + own, 0)
        last = lattice.shape - 1
        beside = [
            sorted((lattice.angle[j, max(i - 1, 0)], lattice.angle[j, min(i + 1, last[j])]))
            for j, i in enumerate(p)
        ]
        if all(low <= q <= high for (low, high), q in zip(beside, goal, strict=True)):
            add(k, goal, outside(machine, goal), np.full(count, sink), to_hold)
    rows, columns, costs = np.concatenate(edges).T
    ends = rows.astype(int), columns.astype(int)
    assert len(np.unique(ends[0] * (sink + 1) + ends[1])) == len(rows)  # SciPy adds equal edges
    matrix = csr_array((costs, ends), shape=(sink + 1, sink + 1))
    return float(dijkstra(matrix, indices=source)[sink])


def outside(machine, q):
    return compute_workspace_excess(machine.arrays, *machine.tip_position(q))


@pytest.mark.parametrize("lattice_of", [long_steps, wide_turns])
def test_the_search_finds_what_dijkstra_finds_and_nothing_undercuts_the_bound(
    machine, terms_of, posture_within, lattice_of
):
    t = terms_of(machine, weights=(0.5, 1.0, SWITCH))
    found = 0
    for start, goal in problems(machine, posture_within, 3):
        goals = goal_at(machine, goal)
        lattice = lattice_of(machine, start)
        searching = LatticeSearch(t, new_path_cost_buffers(t), lattice, goals)
        route = searching.search(math.inf, 10**6)
        expected = by_dijkstra(machine, lattice, goal)
        if route is None:
            assert searching.exhausted
            assert expected == math.inf
            at_all = LatticeSearch(t, new_path_cost_buffers(t), lattice, goals)
            assert (
                at_all.search(math.inf, 10**6, heuristic_weight=2.0, reachability_only=True) is None
            )
            assert at_all.exhausted
            continue
        assert searching.cost == pytest.approx(expected, rel=1e-9)
        hasty = LatticeSearch(t, new_path_cost_buffers(t), lattice, goals)
        assert hasty.search(math.inf, 10**6, heuristic_weight=2.0) is not None
        assert expected * (1 - 1e-9) <= hasty.cost <= 2.0 * expected
        assert hasty.expanded_count <= searching.expanded_count
        at_all = LatticeSearch(t, new_path_cost_buffers(t), lattice, goals)
        assert (
            at_all.search(math.inf, 10**6, heuristic_weight=2.0, reachability_only=True) is not None
        )
        assert at_all.cost >= expected * (1 - 1e-9)
        assert at_all.priced_count <= searching.priced_count
        via, reached = route
        assert reached == 0
        assert via[0] == pytest.approx(machine.cylinder_lengths(start))
        assert via[-1] == pytest.approx(machine.cylinder_lengths(goal))
        tip = machine.tip_position(goal)
        psi, still = np.array([[goal.sum()]]), np.zeros(1)
        exactly = GoalPostures(
            (tip[0], tip[1]),
            tip[None, :],
            goals.posture,
            goals.length,
            np.ones(1),
            psi,
            still,
            None,
        )
        bound = bound_cost_to_goals(machine, t.circuit, via[0], exactly, frozen([0.5, 1.0]))
        assert bound <= expected * (1 + 1e-9)
        found += 1
    assert found >= 2


def test_room_that_is_added_on_the_way_changes_nothing(
    machine, terms_of, posture_within, monkeypatch
):
    t = terms_of(machine, weights=(0.5, 1.0, SWITCH))
    start, goal = next(problems(machine, posture_within, 1))
    goals = goal_at(machine, goal)
    roomy = LatticeSearch(
        t, new_path_cost_buffers(t), lattice_even_in_lengths(machine, start, SPACING / 2), goals
    )
    monkeypatch.setattr(lattice_search, "FIRST_ROWS", 1)
    tight = LatticeSearch(
        t, new_path_cost_buffers(t), lattice_even_in_lengths(machine, start, SPACING / 2), goals
    )
    (one, _), (other, _) = (each.search(math.inf, 10**6) for each in (roomy, tight))
    assert np.array_equal(one, other)
    assert roomy.expanded_count == tight.expanded_count
    assert tight.reached_count > 54  # more than twice the first room


def test_nothing_is_found_that_costs_as_much_as_is_known_already(machine, terms_of, posture_within):
    t = terms_of(machine)
    start, goal = next(problems(machine, posture_within, 1))
    goals = goal_at(machine, goal)

    def searching():
        return LatticeSearch(t, new_path_cost_buffers(t), long_steps(machine, start), goals)

    best = searching()
    assert best.search(math.inf, 10**6) is not None
    assert searching().search(best.cost * (1 - 1e-9), 10**6) is None
    assert searching().search(best.cost * (1 + 1e-9), 10**6) is not None


def test_a_search_stops_when_it_is_late_or_has_expanded_enough(machine, terms_of, posture_within):
    t = terms_of(machine)
    start, goal = next(problems(machine, posture_within, 1))
    goals = goal_at(machine, goal)
    late = LatticeSearch(t, new_path_cost_buffers(t), long_steps(machine, start), goals)
    assert late.search(math.inf, 10**6, Deadline.after(-1.0)) is None
    assert late.expanded_count == 0
    short = LatticeSearch(t, new_path_cost_buffers(t), long_steps(machine, start), goals)
    assert short.search(math.inf, 2) is None
    assert short.expanded_count == 2
