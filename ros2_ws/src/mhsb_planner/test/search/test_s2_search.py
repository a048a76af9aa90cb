"""The search, against SciPy's Dijkstra on the same explicit graph."""

import math
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from tests.support.lower_bounds import energy_lower_bound

from mhsb_model.errors import OutOfWorkspaceError
from mhsb_planner.deadline import Deadline
from mhsb_planner.errors import (
    DeadlineError,
    InfeasibleGoalError,
    NoPathError,
    RequestError,
)
from mhsb_planner.posture.s1_global_search import find_postures_at
from mhsb_planner.search.open_list import NO_STATE
from mhsb_planner.search.s2_graph import StepGraph
from mhsb_planner.search.s2_search import PathQuery, Weights, search
from mhsb_planner.search.s2_start_goal_edges import (
    compute_steps_from_start,
    compute_steps_to_goal,
    create_goal,
    create_start,
)
from mhsb_planner.search.s2_step import compute_step_costs

NORMAL = np.zeros(3, dtype=np.uint8)
ENERGY_OPTIMAL = (0.5, 0.0, 2.0)
TIME_OPTIMAL = (0.0, 15.0, 2.0)
WEIGHTS = [ENERGY_OPTIMAL, TIME_OPTIMAL, (1.0, 10.0, 0.0), (0.1, 0.0, 30.0)]


def cost_of(steps_cost, column, weights):
    return weights[0] * steps_cost[:, column] + weights[1] * steps_cost[:, 0]


def dijkstra_cost(graph, posture, modes, goal_xz, weights, column=1):
    """Cheapest cost by SciPy, on a graph of all states, the start and the goal."""
    layout, edges, patterns = graph.layout, graph.edges, len(graph.table.patterns)
    states = layout.posture_of_state.size
    start, goal = states, states + 1
    rows, columns, costs = [], [], []

    def add(origins, targets, values):
        rows.append(np.asarray(origins))
        columns.append(np.asarray(targets))
        costs.append(np.asarray(values, dtype=float))

    place, end = create_start(graph, posture), create_goal(graph, *goal_xz)
    leaving = edges.last - edges.first
    edge_cost = cost_of(edges.cost, column, weights)
    usable = np.flatnonzero(layout.posture_of_state.ravel() >= 0)
    count = leaving[layout.posture_of_state.ravel()[usable]]
    origin = np.repeat(usable, count)
    offset = np.arange(len(origin)) - np.repeat(np.cumsum(count) - count, count)
    edge = np.repeat(edges.first[layout.posture_of_state.ravel()[usable]], count) + offset
    switched = graph.switches[origin % patterns, edges.pattern[edge]]
    add(origin, edges.state[edge], edge_cost[edge] + weights[2] * switched)

    first = compute_steps_from_start(graph, place, end)
    switched = np.count_nonzero(graph.table.patterns[first.pattern] != modes, axis=1)
    target = np.where(first.state == NO_STATE, goal, first.state)
    values = cost_of(first.cost, column, weights) + weights[2] * switched
    add(np.full(len(target), start), target, values)

    last, _ = compute_steps_to_goal(graph, end)
    values = cost_of(last.cost, column, weights)
    owner = layout.posture_of_state.ravel()
    for posture_index, pattern, value in zip(last.origin, last.pattern, values, strict=True):
        origin = np.flatnonzero(owner == posture_index)
        switched = graph.switches[origin % patterns, pattern]
        add(origin, np.full(len(origin), goal), value + weights[2] * switched)

    row, column_, cost = map(np.concatenate, (rows, columns, costs))
    order = np.lexsort((cost, column_, row))  # of parallel steps the cheapest
    row, column_, cost = row[order], column_[order], cost[order]
    kept = np.append(True, (np.diff(row) != 0) | (np.diff(column_) != 0))
    matrix = csr_array((cost[kept], (row[kept], column_[kept])), shape=(goal + 1, goal + 1))
    return dijkstra(matrix, indices=start)[goal]


def random_queries(graph, count, seed, off_grid):
    rng = np.random.default_rng(seed)
    table = graph.table
    nodes = np.flatnonzero(table.feasible)
    while count:
        a, b = rng.choice(nodes, 2, replace=False)
        posture = table.posture[a, rng.integers(len(table.patterns))]
        x, z = table.nodes[b] * table.spacing
        if off_grid:
            posture = posture + rng.uniform(-0.05, 0.05, 3)
            x, z = x + rng.uniform(-0.02, 0.02), z + rng.uniform(-0.02, 0.02)
        try:
            create_goal(graph, x, z)
        except (InfeasibleGoalError, OutOfWorkspaceError):
            continue
        count -= 1
        yield posture, table.patterns[rng.integers(len(table.patterns))], (x, z)


@pytest.mark.parametrize("off_grid", [False, True])
@pytest.mark.parametrize("weights", WEIGHTS)
def test_the_cost_is_that_of_dijkstra(graph, weights, off_grid):
    for posture, modes, goal in random_queries(graph, 8, seed=11, off_grid=off_grid):
        expected = dijkstra_cost(graph, posture, modes, goal, weights)
        if np.isfinite(expected):
            path = search(graph, PathQuery(posture, modes, goal, Weights(*weights)))
            assert path.cost == pytest.approx(expected, rel=1e-9)


def test_the_series_reading_can_be_optimised_too(graph):
    for posture, modes, goal in random_queries(graph, 8, seed=12, off_grid=True):
        expected = dijkstra_cost(graph, posture, modes, goal, ENERGY_OPTIMAL, column=2)
        path = search(graph, PathQuery(posture, modes, goal, Weights(*ENERGY_OPTIMAL), "series"))
        assert path.cost == pytest.approx(expected, rel=1e-9)
        paper = search(graph, PathQuery(posture, modes, goal, Weights(*ENERGY_OPTIMAL), "paper"))
        assert path.cost <= 0.5 * paper.energy_series.sum() + 2 * paper.switches + 1e-9


@pytest.mark.parametrize("off_grid", [False, True])
def test_a_path_costs_what_its_steps_cost(graph, machine, off_grid):
    for posture, modes, goal in random_queries(graph, 20, seed=13, off_grid=off_grid):
        path = search(graph, PathQuery(posture, modes, goal, Weights(0.5, 3.0, 2.0)))
        for k in range(path.steps):
            costs = compute_step_costs(machine, path.posture[k], path.posture[k + 1])
            p = int(np.flatnonzero(np.all(machine.patterns == path.modes[k], axis=1))[0])
            if costs.admissible[p]:
                found = (path.duration[k], path.energy[k], path.energy_series[k])
                expected = (costs.duration[p], costs.energy[p], costs.energy_series[p])
                assert found == pytest.approx(expected, rel=1e-9)
        total = 0.5 * path.energy.sum() + 3.0 * path.duration.sum() + 2.0 * path.switches
        assert path.cost == pytest.approx(total, rel=1e-9)


@pytest.mark.parametrize("off_grid", [False, True])
def test_a_path_leads_from_the_start_over_neighbouring_nodes_to_the_goal(graph, machine, off_grid):
    spacing = graph.table.spacing
    for posture, modes, goal in random_queries(graph, 20, seed=14, off_grid=off_grid):
        path = search(graph, PathQuery(posture, modes, goal, Weights(*ENERGY_OPTIMAL)))
        assert np.array_equal(path.posture[0], posture)
        assert np.array_equal(path.start_modes, modes)
        assert tuple(path.tip[-1]) == goal
        for tip, q in zip(path.tip, path.posture, strict=True):
            assert machine.tip_position(q) == pytest.approx(tip, abs=1e-9)
        inner = path.tip[1:-1] / spacing
        assert inner == pytest.approx(np.round(inner), abs=1e-9)
        moves = np.max(np.abs(np.diff(path.tip, axis=0)), axis=1)
        assert moves[1:-1] == pytest.approx(spacing)
        assert np.all(moves <= spacing * (1 + 1e-6))


def test_strokes_add_up_to_the_distance_of_start_and_goal(graph, machine):
    for posture, modes, goal in random_queries(graph, 10, seed=15, off_grid=True):
        path = search(graph, PathQuery(posture, modes, goal, Weights(*ENERGY_OPTIMAL)))
        length = np.array([machine.cylinder_lengths(q) for q in path.posture])
        assert np.diff(length, axis=0).sum(axis=0) == pytest.approx(length[-1] - length[0])
        least = energy_lower_bound(machine, posture, path.posture[-1:])
        assert path.energy.sum() >= least
        assert path.energy_series.sum() >= least


def test_the_goal_posture_is_that_of_the_largest_polytope_for_the_last_mode(graph, machine):
    for posture, modes, goal in random_queries(graph, 10, seed=16, off_grid=True):
        path = search(graph, PathQuery(posture, modes, goal, Weights(*ENERGY_OPTIMAL)))
        best = find_postures_at(machine, *goal).posture
        p = int(np.flatnonzero(np.all(machine.patterns == path.modes[-1], axis=1))[0])
        assert np.array_equal(path.posture[-1], best[p])


def test_steps_to_a_goal_on_a_node_are_those_computed_for_it(graph):
    for node in np.flatnonzero(graph.table.feasible)[::50]:
        goal = create_goal(graph, *(graph.table.nodes[node] * graph.table.spacing))
        assert goal.node == node
        found, first = compute_steps_to_goal(graph, goal)
        expected, expected_first = compute_steps_to_goal(graph, replace(goal, node=None))
        assert np.array_equal(first, expected_first)
        for name in ("origin", "state", "end", "pattern"):
            assert np.array_equal(getattr(found, name), getattr(expected, name))
        assert found.cost == pytest.approx(expected.cost, rel=1e-9)


def a_node(graph, x, z):
    return graph.table.posture[graph.grid.node_at(x, z), 0]


def test_a_goal_with_an_end_link_angle_is_reached_with_it(graph):
    start = a_node(graph, 0.55, -0.05)
    wanted = float(find_postures_at(graph.machine, 0.62, 0.33).posture[0].sum()) - 0.02
    path = search(
        graph, PathQuery(start, NORMAL, (0.62, 0.33), Weights(*ENERGY_OPTIMAL), goal_psi=wanted)
    )
    turns = (path.posture[-1].sum() - wanted) / (2 * np.pi)
    assert turns == pytest.approx(round(turns), abs=1e-9)


def test_start_and_goal_in_one_cell_are_joined_by_a_single_step(graph, machine):
    start = find_postures_at(machine, 0.61, 0.31).posture[0]
    path = search(graph, PathQuery(start, NORMAL, (0.63, 0.33), Weights(1.0, 10.0, 50.0)))
    assert path.steps == 1
    assert path.tip == pytest.approx(np.array([[0.61, 0.31], [0.63, 0.33]]))


def test_a_start_at_the_goal_needs_no_step(graph):
    start = a_node(graph, 0.55, 0.20)
    path = search(graph, PathQuery(start, NORMAL, (0.55, 0.20), Weights(*ENERGY_OPTIMAL)))
    assert (path.steps, path.cost, path.switches, path.length) == (0, 0.0, 0, 0.0)
    assert np.array_equal(path.posture, [start])


def test_a_start_at_the_goal_with_another_end_link_angle_moves(graph, machine):
    start = a_node(graph, 0.55, 0.20)
    other = start.sum() + 0.1
    if len(machine.postures(0.55, 0.20, np.array([other]))) == 0:
        other = start.sum() - 0.1
    path = search(
        graph, PathQuery(start, NORMAL, (0.55, 0.20), Weights(*ENERGY_OPTIMAL), goal_psi=other)
    )
    assert path.steps >= 1
    assert path.posture[-1].sum() == pytest.approx(other)


def test_with_weights_of_zero_the_path_has_the_fewest_steps(graph):
    start = a_node(graph, 0.55, -0.05)
    path = search(graph, PathQuery(start, NORMAL, (0.55, 0.60), Weights(0.0, 0.0, 0.0)))
    assert path.cost == 0.0
    assert path.steps == 13


def test_more_weight_on_time_never_makes_a_path_slower(graph):
    start = a_node(graph, 0.55, -0.05)
    times = [
        search(
            graph, PathQuery(start, NORMAL, (0.55, 0.60), Weights(0.5, time, 2.0))
        ).duration.sum()
        for time in (0.0, 5.0, 20.0, 100.0)
    ]
    assert times == sorted(times, reverse=True)


def test_the_same_question_has_the_same_answer_to_the_bit(graph):
    for posture, modes, goal in random_queries(graph, 5, seed=17, off_grid=True):
        first, again = (
            search(graph, PathQuery(posture, modes, goal, Weights(*TIME_OPTIMAL))) for _ in range(2)
        )
        assert first.posture.tobytes() == again.posture.tobytes()
        assert first.modes.tobytes() == again.modes.tobytes()
        assert first.statistics.expanded == again.statistics.expanded


def test_a_start_among_nodes_out_of_reach_is_joined_to_those_around(graph, machine, table):
    """A point whose cell has no feasible corner, yet a posture of its own."""
    rng = np.random.default_rng(18)
    for _ in range(2000):
        q = rng.uniform(machine.arrays.joint_min, machine.arrays.joint_max)
        x, z = machine.tip_position(q)
        corners = graph.grid.cell_corners(x, z)
        wider = graph.grid.cell_corners(x, z, 1)
        if not table.feasible[corners].any() and table.feasible[wider].any():
            with suppress(NoPathError):
                assert (
                    search(graph, PathQuery(q, NORMAL, (0.6, 0.0), Weights(*ENERGY_OPTIMAL))).steps
                    > 1
                )
                return
    pytest.skip("this machine has no such point")


def test_a_goal_outside_the_workspace_is_refused(graph):
    with pytest.raises(OutOfWorkspaceError):
        search(
            graph, PathQuery(a_node(graph, 0.55, 0.2), NORMAL, (1.2, 0.0), Weights(*ENERGY_OPTIMAL))
        )


def test_a_goal_without_posture_is_refused(graph, table):
    x, z = table.nodes[~table.feasible][0] * table.spacing
    start = a_node(graph, 0.55, 0.2)
    with pytest.raises(InfeasibleGoalError, match=r"puts the tip at"):
        search(graph, PathQuery(start, NORMAL, (x, z), Weights(*ENERGY_OPTIMAL)))
    with pytest.raises(InfeasibleGoalError, match="with the end link at 3 rad"):
        search(graph, PathQuery(start, NORMAL, (0.9, 0.0), Weights(*ENERGY_OPTIMAL), goal_psi=3.0))


def test_a_load_that_cannot_be_lifted_has_no_path(graph, machine):
    heavy = graph.create_for(machine.changed(payload=200.0))
    with pytest.raises(NoPathError, match="no sequence of admissible steps leads from"):
        search(
            heavy, PathQuery(a_node(graph, 0.8, -0.3), NORMAL, (0.8, 0.3), Weights(*ENERGY_OPTIMAL))
        )


def test_a_search_after_its_deadline_says_so(graph):
    over = Deadline.after(-1.0)
    with pytest.raises(DeadlineError, match="the search for a path did not end before"):
        search(
            graph,
            PathQuery(a_node(graph, 0.55, -0.7), NORMAL, (0.55, 0.75), Weights(0, 0, 0)),
            deadline=over,
        )


def test_a_goal_off_the_grid_is_given_up_when_the_deadline_has_passed(machine, looks):
    assert np.array_equal(
        find_postures_at(machine, 0.61, 0.31, looks.deadline_after(math.inf)).posture,
        find_postures_at(machine, 0.61, 0.31).posture,
    )
    for after in range(5):
        with pytest.raises(DeadlineError, match="the search for the goal's postures"):
            find_postures_at(machine, 0.61, 0.31, looks.deadline_after(after))
        assert looks.count == after + 1


def test_steps_that_could_not_be_priced_in_time_are_priced_later(graph, machine):
    lighter = graph.create_for(machine.changed(payload=3.0))
    with pytest.raises(DeadlineError, match="the pricing of steps"):
        lighter.steps.price_all(Deadline.after(-1.0))
    assert not lighter.steps.complete
    assert lighter.steps.edges.used[0] == 0
    complete = StepGraph(lighter.machine, graph.table)
    assert np.array_equal(lighter.edges.cost, complete.edges.cost)


@pytest.mark.parametrize("weights", [(-1.0, 0, 0), (0, float("nan"), 0), (0, 0, float("inf"))])
def test_useless_weights_are_refused(weights):
    with pytest.raises(RequestError, match="must be finite and not negative"):
        Weights(*weights)


@pytest.mark.parametrize("posture", [[0.0, 0.0], [0.0, 0.0, float("nan")]])
def test_a_useless_start_is_refused(graph, posture):
    with pytest.raises(RequestError, match="start posture must be 3 finite numbers"):
        search(graph, PathQuery(posture, NORMAL, (0.55, 0.2), Weights(*ENERGY_OPTIMAL)))


def test_an_unknown_energy_reading_is_refused(graph):
    with pytest.raises(RequestError, match="energy_reading must be paper or series"):
        search(
            graph,
            PathQuery(
                a_node(graph, 0.55, 0.2), NORMAL, (0.6, 0.2), Weights(*ENERGY_OPTIMAL), "guess"
            ),
        )
