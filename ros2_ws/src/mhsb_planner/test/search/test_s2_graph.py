"""The explicit graph, against steps worked out one by one."""

import numpy as np
import pytest

from mhsb_planner.search.s2_edge_costs import PricedSteps
from mhsb_planner.search.s2_graph import StepGraph
from mhsb_planner.search.s2_search import PathQuery, Weights, search


def edges_from(graph, posture):
    """{state: (T, E paper, E series)} of the steps that leave a posture."""
    edges = graph.edges
    part = slice(edges.first[posture], edges.last[posture])
    return dict(zip(edges.state[part].tolist(), map(tuple, edges.cost[part]), strict=True))


def steps_by_the_book(graph, machine, posture, slow_steps):
    table, layout = graph.table, graph.layout
    node = layout.node[posture]
    near = np.max(np.abs(table.nodes - table.nodes[node]), axis=1) == 1
    expected = {}
    for other in np.flatnonzero(near & table.feasible):
        steps = slow_steps(machine, layout.posture[posture], table.posture[other])
        for p, cost in steps.items():
            expected[int(other) * len(table.patterns) + p] = cost
    return expected


def assert_edges_by_the_book(graph, machine, slow_steps, count, seed):
    rng = np.random.default_rng(seed)
    for posture in rng.choice(len(graph.layout.posture), count, replace=False):
        found = edges_from(graph, posture)
        expected = steps_by_the_book(graph, machine, posture, slow_steps)
        assert set(found) == set(expected)
        for state, cost in expected.items():
            assert found[state] == pytest.approx(cost, rel=1e-9)


def test_edges_are_the_admissible_steps_to_the_neighbours(graph, machine, slow_steps):
    assert_edges_by_the_book(graph, machine, slow_steps, count=25, seed=1)


@pytest.mark.parametrize(
    "change", [{"payload": 4.0}, {"supply_pressure": 2.5e6}, {"max_piston_speed": 0.03}]
)
def test_after_a_change_edges_are_those_of_the_changed_machine(graph, machine, slow_steps, change):
    arm = machine.changed(**change)
    changed = graph.create_for(arm)
    assert_edges_by_the_book(changed, arm, slow_steps, count=5, seed=2)
    fresh = StepGraph(arm, graph.table)
    assert np.array_equal(changed.edges.state, fresh.edges.state)
    assert changed.edges.cost == pytest.approx(fresh.edges.cost, rel=1e-9)


def test_a_change_leaves_the_graph_it_came_from_as_it_was(graph, machine):
    before = graph.edges.cost.tobytes()
    graph.create_for(machine.changed(payload=1.0))
    assert graph.edges.cost.tobytes() == before
    with pytest.raises(ValueError, match="read-only"):
        graph.edges.cost[0, 0] = 0.0


def test_a_search_prices_no_more_steps_than_it_comes_by(graph, machine):
    arm = machine.changed(payload=9.0)
    changed = graph.create_for(arm)
    assert not changed.steps.complete
    start = graph.table.posture[graph.grid.node_at(0.55, 0.20), 0]
    weights, normal = (0.5, 0.0, 2.0), np.zeros(3, dtype=np.uint8)
    found = search(changed, PathQuery(start, normal, (0.68, 0.12), Weights(*weights)))
    priced = np.flatnonzero(changed.steps.edges.first >= 0)
    assert 0 < len(priced) < 0.9 * len(graph.layout.posture)

    fresh = StepGraph(arm, graph.table)
    expected = search(fresh, PathQuery(start, normal, (0.68, 0.12), Weights(*weights)))
    assert found.cost == pytest.approx(expected.cost, rel=1e-9)
    assert found.modes.tolist() == expected.modes.tolist()
    for posture in priced[::10]:
        steps, expected_steps = edges_from(changed, posture), edges_from(fresh, posture)
        assert steps.keys() == expected_steps.keys()
        for state, cost in steps.items():
            assert cost == pytest.approx(expected_steps[state], rel=1e-9)
    assert changed.steps.complete
    assert len(changed.edges.state) == len(fresh.edges.state)


def test_room_for_steps_grows_as_they_are_priced(graph):
    steps = PricedSteps(graph.steps.cost_model, jobs=1, room=0)
    for postures in np.array_split(np.arange(len(graph.layout.posture)), 7):
        steps.price(postures)
        steps.price(postures[:3])
    assert steps.edges.used[0] == len(graph.edges.state)
    assert steps.edges.cost[: len(graph.edges.cost)].tobytes() == graph.edges.cost.tobytes()


def test_a_search_makes_room_for_the_steps_it_prices(graph, machine):
    changed = graph.create_for(machine)
    changed.steps = PricedSteps(graph.steps.cost_model, jobs=1, room=0)
    start = graph.table.posture[graph.grid.node_at(0.55, 0.20), 0]
    goal, weights = (0.68, -0.32), (0.5, 0.0, 2.0)
    paths = [
        search(each, PathQuery(start, np.zeros(3), goal, Weights(*weights)))
        for each in (graph, changed)
    ]
    assert paths[0].posture.tobytes() == paths[1].posture.tobytes()
    assert paths[0].energy.tobytes() == paths[1].energy.tobytes()
    assert paths[0].statistics.expanded == paths[1].statistics.expanded


def test_every_state_has_its_posture_of_the_table(graph):
    layout, table = graph.layout, graph.table
    for node in range(len(table.nodes)):
        if table.feasible[node]:
            assert np.array_equal(
                layout.posture[layout.posture_of_state[node]], table.posture[node]
            )
            assert np.all(layout.node[layout.posture_of_state[node]] == node)
        else:
            assert np.all(layout.posture_of_state[node] == -1)


def test_postures_of_a_node_are_distinct(graph):
    layout = graph.layout
    assert len(np.unique(layout.posture, axis=0)) == len(layout.posture)


def test_the_number_of_threads_does_not_change_a_bit(graph, machine):
    alone = StepGraph(machine, graph.table, jobs=1)
    assert alone.edges.cost.tobytes() == graph.edges.cost.tobytes()
    assert alone.edges.state.tobytes() == graph.edges.state.tobytes()


def test_switches_count_the_actuators_whose_mode_differs(graph):
    patterns = graph.table.patterns
    for a, row in enumerate(graph.switches):
        for b, count in enumerate(row):
            assert count == np.sum(patterns[a] != patterns[b])
