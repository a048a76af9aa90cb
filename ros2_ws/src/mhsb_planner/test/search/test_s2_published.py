"""The published search, against the same search written with dictionaries and slow steps."""

import math

import numpy as np
import pytest

from mhsb_planner.errors import (
    DeadlineError,
    NoPathError,
    RequestError,
)
from mhsb_planner.posture.s1_global_search import build_posture_table
from mhsb_planner.search.s2_graph import StepGraph
from mhsb_planner.search.s2_search import PathQuery, Weights, search

NORMAL = np.zeros(3, dtype=np.uint8)
ENERGY_OPTIMAL = (0.5, 0.0, 2.0)
TIME_OPTIMAL = (0.0, 15.0, 2.0)
SCALE = 3.0


@pytest.fixture(scope="module")
def coarse(slider_crank_machine):
    """Few nodes, since the oracle is slow; of a machine that can do such long steps."""
    return StepGraph(slider_crank_machine, build_posture_table(slider_crank_machine, spacing=0.15))


@pytest.fixture(scope="module")
def published_by_the_book(coarse, slow_steps):
    """Function (start node, goal node, weights) that gives the goal's label: cost, label path."""
    table = coarse.table
    known = {}

    def steps(posture, node):
        key = (tuple(posture), node)
        if key not in known:
            known[key] = slow_steps(coarse.machine, posture, table.posture[node])
        return known[key]

    def neighbors(node):
        return [
            other
            for other in range(len(table.nodes))
            if np.abs(table.nodes[other] - table.nodes[node]).max() == 1 and table.feasible[other]
        ]

    def solve(start, goal, weights):
        w1, w2, w3 = weights
        # Like the search, the start stands apart from its node and the goal from its own.
        labels = {"start": (0.0, table.posture[start, 0], NORMAL, None)}
        final = set()
        while "goal" not in final:

            def estimate(name):
                if name in ("goal", "start"):
                    return labels[name][0]
                away = table.spacing * math.dist(table.nodes[name], table.nodes[goal])
                return labels[name][0] + SCALE * away

            here = min((name for name in labels if name not in final), key=estimate)
            final.add(here)
            if here == "goal":
                break
            cost, posture, modes, _ = labels[here]
            for node in neighbors(start if here == "start" else here):
                for name in (node, "goal") if node == goal else (node,):
                    for p, (seconds, joules, _) in steps(posture, node).items():
                        pattern = table.patterns[p]
                        total = cost + w1 * joules + w2 * seconds
                        total += w3 * np.count_nonzero(pattern != modes)
                        if name not in final and total < labels.get(name, (math.inf,))[0]:
                            labels[name] = (total, table.posture[node, p], pattern, here)
        path, name = [], "goal"
        while name is not None:
            path.append(name)
            name = labels[name][3]
        return labels["goal"][0], path[::-1]

    return solve


def tip(table, node):
    return tuple(table.nodes[node] * table.spacing)


@pytest.mark.parametrize("weights", [ENERGY_OPTIMAL, TIME_OPTIMAL])
def test_it_finds_what_the_same_search_finds_by_the_book(coarse, published_by_the_book, weights):
    table = coarse.table
    rng = np.random.default_rng(31)
    for _ in range(2):
        start, goal = rng.choice(np.flatnonzero(table.feasible), 2, replace=False)
        path = search(
            coarse,
            PathQuery(table.posture[start, 0], NORMAL, tip(table, goal), Weights(*weights)),
            method="published",
            heuristic_scale=SCALE,
        )
        cost, names = published_by_the_book(start, goal, weights)
        assert path.cost == pytest.approx(cost, rel=1e-9)
        nodes = [start, *names[1:-1], goal]
        assert path.tip == pytest.approx(np.array([tip(table, node) for node in nodes]))


def queries(graph, count, seed):
    table = graph.table
    rng = np.random.default_rng(seed)
    for _ in range(count):
        a, b = rng.choice(np.flatnonzero(table.feasible), 2, replace=False)
        yield table.posture[a, rng.integers(len(table.patterns))], tip(table, b)


@pytest.mark.parametrize("weights", [ENERGY_OPTIMAL, TIME_OPTIMAL])
def test_it_is_never_better_than_the_exact_search_and_sometimes_worse(graph, weights):
    costs = np.array(
        [
            [
                search(graph, PathQuery(q, NORMAL, goal, Weights(*weights)), method=m).cost
                for m in ("exact", "published")
            ]
            for q, goal in queries(graph, 20, seed=32)
        ]
    )
    assert np.all(costs[:, 1] >= costs[:, 0] * (1 - 1e-12))
    assert np.any(costs[:, 1] > costs[:, 0] * (1 + 1e-6))


def test_its_path_costs_what_its_steps_cost(graph):
    for q, goal in queries(graph, 20, seed=33):
        path = search(graph, PathQuery(q, NORMAL, goal, Weights(0.5, 3.0, 2.0)), method="published")
        total = 0.5 * path.energy.sum() + 3.0 * path.duration.sum() + 2.0 * path.switches
        assert path.cost == pytest.approx(total, rel=1e-9)
        assert path.steps > 0


def test_with_weights_of_zero_it_follows_the_distance_alone(graph):
    start = graph.table.posture[graph.grid.node_at(0.55, -0.05), 0]
    path = search(
        graph, PathQuery(start, NORMAL, (0.55, 0.60), Weights(0.0, 0.0, 0.0)), method="published"
    )
    assert path.tip[:, 0] == pytest.approx(0.55)
    assert path.steps == path.statistics.expanded == 13


def test_a_larger_scale_expands_fewer_labels(graph):
    start = graph.table.posture[graph.grid.node_at(0.55, -0.05), 0]
    expanded = [
        search(
            graph,
            PathQuery(start, NORMAL, (0.55, 0.60), Weights(*ENERGY_OPTIMAL)),
            method="published",
            heuristic_scale=scale,
        ).statistics.expanded
        for scale in (0.0, 100.0, 1e5)
    ]
    assert expanded == sorted(expanded, reverse=True)
    assert expanded[-1] < expanded[0]


def test_start_and_goal_off_the_grid_are_joined_to_it(graph, machine):
    start = machine.postures(0.61, 0.31, np.linspace(-3, 3, 99))[0]
    path = search(
        graph, PathQuery(start, NORMAL, (0.68, -0.22), Weights(*ENERGY_OPTIMAL)), method="published"
    )
    assert machine.tip_position(path.posture[-1]) == pytest.approx((0.68, -0.22))
    assert np.array_equal(path.posture[0], start)


METHODS = ("exact", "published")


@pytest.mark.parametrize("method", METHODS)
def test_both_searches_end_with_the_first_look_that_finds_the_deadline_passed(graph, looks, method):
    start = graph.table.posture[graph.grid.node_at(0.55, -0.70), 0]

    def searched(after):
        deadline = looks.deadline_after(after)
        query = PathQuery(start, NORMAL, (0.55, 0.75), Weights(*ENERGY_OPTIMAL))
        return search(graph, query, method=method, deadline=deadline)

    assert searched(math.inf).steps > 0
    needed = looks.count
    assert needed > 3
    for after in range(needed - 1):
        with pytest.raises(DeadlineError, match="did not end before the deadline"):
            searched(after)
        assert looks.count <= after + 3  # two of them measure the portion


def test_what_it_cannot_work_with_is_refused(graph):
    start = graph.table.posture[graph.grid.node_at(0.55, 0.20), 0]
    with pytest.raises(RequestError, match="search method must be one of exact, published"):
        search(
            graph, PathQuery(start, NORMAL, (0.6, 0.2), Weights(*ENERGY_OPTIMAL)), method="guess"
        )
    with pytest.raises(RequestError, match="heuristic scale must be finite and not negative"):
        search(
            graph,
            PathQuery(start, NORMAL, (0.6, 0.2), Weights(*ENERGY_OPTIMAL)),
            method="published",
            heuristic_scale=-1.0,
        )


def test_where_nothing_leads_it_says_so(graph, machine):
    heavy = graph.create_for(machine.changed(payload=200.0))
    start = graph.table.posture[graph.grid.node_at(0.8, -0.3), 0]
    with pytest.raises(NoPathError):
        search(
            heavy,
            PathQuery(start, NORMAL, (0.8, 0.3), Weights(*ENERGY_OPTIMAL)),
            method="published",
        )
