"""The graph of kept joints: built once for a start, priced anew for another machine."""

from types import SimpleNamespace

import numpy as np

from mhsb_planner.deadline import NO_DEADLINE
from mhsb_planner.planners.fixed import FixedPlanner
from mhsb_planner.planners.options import PlanOptions
from mhsb_planner.planners.path_sources import limit_speeds
from mhsb_planner.search import fixed_j3


def test_a_graph_is_built_once_and_priced_for_each_machine(machine, table, graph, monkeypatch):
    built, build = [], fixed_j3.build_fixed_j3_graph

    def noted(*arguments, **named):
        built.append(arguments)
        return build(*arguments, **named)

    monkeypatch.setattr(fixed_j3, "build_fixed_j3_graph", noted)
    monkeypatch.setattr(FixedPlanner, "_newest", (None, None))
    start = machine.postures(0.55, 0.2, np.linspace(-3.0, 3.0, 50))[0]

    def find(graph, j3):
        options = PlanOptions(planner="fixed", initial_j3=j3)
        request = SimpleNamespace(options=options, departure=start)
        return FixedPlanner()._find_graph(graph, request, NO_DEADLINE)

    first = find(graph, -1.0)
    assert find(graph, -1.0) is first
    slower = graph.create_for(limit_speeds(machine, 0.5))
    found = find(slower, -1.0)
    assert len(built) == 1
    elbow = fixed_j3.find_elbow_side(machine, start)
    expected = build(slower.machine, table, -1.0, elbow)
    assert all(map(np.array_equal, found.edges, expected.edges))
    assert not np.array_equal(found.edges.cost, first.edges.cost)
    find(graph, -0.9)
    assert len(built) == 2
