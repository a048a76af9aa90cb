"""Register a planner of your own: it turns all joints evenly to a goal posture.

    python examples/04_own_planner.py

A path planner yields discrete paths. Smooth motion, modes over time and energy are computed from
them as for any other planner (docs/planners.md).
"""

from itertools import pairwise

import numpy as np

from mhsb_model import MotionState, load_machine
from mhsb_planner import Planner, PlanOptions, load_or_build_table
from mhsb_planner.integrated.goal_postures import sample_goal_postures
from mhsb_planner.planners.path_planner import PathProposal
from mhsb_planner.planners.registry import REGISTERED_PLANNERS
from mhsb_planner.search.discrete_path import DiscretePath, SearchStatistics
from mhsb_planner.search.s2_step import step_costs


def make_path(graph, task, posture):
    """Return the discrete path through postures, in the cheapest modes that each step admits."""
    steps = [step_costs(graph.machine, *ends) for ends in pairwise(posture)]
    cheapest = [int(np.nanargmin(step.energy)) for step in steps]  # NaN where it is not admissible
    pairs = zip(steps, cheapest, strict=True)
    taken = np.array([(s.duration[p], s.energy[p], s.energy_series[p]) for s, p in pairs])
    cost = float(task.options.weights.energy * taken[:, 1].sum())
    statistics = SearchStatistics(0, len(steps), 0.0)
    tips, modes = graph.machine.tip_positions(posture), graph.machine.patterns[cheapest]
    found = *taken.T, cost, task.modes.modes, statistics
    return DiscretePath(tips, posture, modes, *found)


class StraightPlanner:
    """Turns all joints evenly to each of the three goal postures with the shortest strokes."""

    name, summary = "straight", "turns all joints evenly to a near goal posture"
    trajectory, weighs_area, baselines, takes = "followed", False, (), ()

    def paths(self, graph, task, progress):
        """Yield one path after the other; the search ends when the time is up."""
        goals = sample_goal_postures(graph.machine, *task.planar_goal).postures
        stroke = goals.length - graph.machine.cylinder_lengths(task.departure)
        for k in np.argsort(np.abs(stroke).max(axis=1))[:3]:
            posture = np.linspace(task.departure, goals.posture[k], 41)
            yield PathProposal(make_path(graph, task, posture))

    def warm_up(self, graph):
        """Compile nothing: it has no compiled functions of its own."""


REGISTERED_PLANNERS[StraightPlanner.name] = StraightPlanner()

machine = load_machine()
planner = Planner(machine, load_or_build_table(machine))
start = MotionState.at_rest(machine.config.simulation.start_posture)
for name in ("straight", "integrated"):
    print(name, repr(planner.plan((0.55, 0.30), start, options=PlanOptions(planner=name))))
