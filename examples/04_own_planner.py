"""Register a planner of your own: it turns all joints evenly to a goal posture.

    python examples/04_own_planner.py

Smooth motion, modes over time and energy follow from its paths (docs/planners.md#to-add-one).
"""

from collections.abc import Iterator

import numpy as np

from mhsb_model import MotionState, load_machine
from mhsb_planner import Planner, PlanOptions
from mhsb_planner.errors import NoPathError
from mhsb_planner.integrated.goal_postures import sample_goal_postures
from mhsb_planner.planners.path_planner import PathPlanner, PathProposal, PathRequest
from mhsb_planner.planners.priced_path import price_path
from mhsb_planner.planners.registry import REGISTERED_PLANNERS
from mhsb_planner.progress import PlanProgress
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_planner.search.s2_graph import StepGraph


class StraightPlanner(PathPlanner):
    """Turns all joints evenly to each of the three goal postures with the shortest strokes."""

    name, summary = "straight", "turns all joints evenly to a near goal posture"

    def paths(
        self, graph: StepGraph, request: PathRequest, progress: PlanProgress
    ) -> Iterator[PathProposal]:
        """Yield a path to each of these goal postures that has one."""
        machine, options, start = graph.machine, request.options, request.departure
        tip, modes = machine.tip_position(start), request.modes.modes
        if request.begins_at_goal(machine):
            yield PathProposal(DiscretePath.create_without_steps(tip, start, modes, 0.0))
            return
        psi, region = options.goal_psi, options.goal_region
        goals = sample_goal_postures(machine, *request.planar_goal, psi, region=region)
        stroke = np.abs(goals.length - machine.cylinder_lengths(start)).max(axis=1)
        found = False
        for posture in goals.posture[np.argsort(stroke)[:3]]:
            if path := price_path(machine, request, np.linspace(start, posture, 41), progress):
                found = True
                yield PathProposal(path)
        if not found:
            raise NoPathError(tip, request.goal)

    def warm_up(self, graph: StepGraph) -> None:
        """Call the kernels of `paths`, except those of steps, which are called for all planners."""
        sample_goal_postures(graph.machine, *graph.machine.tip_position(graph.layout.posture[0]))


REGISTERED_PLANNERS[StraightPlanner.name] = StraightPlanner()
machine = load_machine()
planner = Planner(machine)
start = MotionState.at_rest(machine.config.simulation.start_posture)
for name in ("straight", "integrated"):
    print(name, repr(planner.plan((0.55, 0.30), start, options=PlanOptions(planner=name))))
