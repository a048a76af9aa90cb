"""Register a planner of your own: it turns all joints evenly to a goal posture.

    python examples/04_own_planner.py

A path planner yields discrete paths. Smooth motion, modes over time and energy are computed from
them as for any other planner (docs/planners.md#to-add-one).
"""

import numpy as np

from mhsb_model import MotionState, load_machine
from mhsb_planner import Planner, PlanOptions, load_or_build_table
from mhsb_planner.errors import NoPathError
from mhsb_planner.integrated.goal_postures import sample_goal_postures
from mhsb_planner.planners.path_planner import PathProposal
from mhsb_planner.planners.priced_path import price_path
from mhsb_planner.planners.registry import REGISTERED_PLANNERS
from mhsb_planner.search.discrete_path import DiscretePath


class StraightPlanner:
    """Turns all joints evenly to each of the three goal postures with the shortest strokes."""

    name, summary = "straight", "turns all joints evenly to a near goal posture"
    trajectory, weighs_area, baselines, takes = "followed", False, (), ()

    def paths(self, graph, task, progress):
        """Yield a path to each of these goal postures that has one."""
        machine, options, start = graph.machine, task.options, task.departure
        tip, modes = machine.tip_position(start), task.modes.modes
        if task.begins_at_goal(machine):
            yield PathProposal(DiscretePath.create_without_steps(tip, start, modes, 0.0))
            return
        psi, region = options.goal_psi, options.goal_region
        goals = sample_goal_postures(machine, *task.planar_goal, psi, region=region)
        stroke = np.abs(goals.length - machine.cylinder_lengths(start)).max(axis=1)
        found = False
        for k in np.argsort(stroke)[:3]:
            posture = np.linspace(start, goals.posture[k], 41)
            path = price_path(machine, task, posture, progress)
            if path is not None:
                found = True
                yield PathProposal(path)
        if not found:
            raise NoPathError(tip, task.goal)

    def warm_up(self, graph):
        """Call the kernels of `paths`, except those of steps, which are called for all planners."""
        sample_goal_postures(graph.machine, *graph.machine.tip_position(graph.layout.posture[0]))


REGISTERED_PLANNERS[StraightPlanner.name] = StraightPlanner()

machine = load_machine()
planner = Planner(machine, load_or_build_table(machine))
start = MotionState.at_rest(machine.config.simulation.start_posture)
for name in ("straight", "integrated"):
    print(name, repr(planner.plan((0.55, 0.30), start, options=PlanOptions(planner=name))))
