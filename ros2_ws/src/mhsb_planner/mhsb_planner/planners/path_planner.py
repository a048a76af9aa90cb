"""What a planner is: where a path's postures come from, and the paths it gives, one by one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

from mhsb_model.trajectory import MotionState, Trajectory
from mhsb_model.types import FloatArray, Position
from mhsb_planner.integrated.certificate import least_cost_to
from mhsb_planner.integrated.goal_postures import goal_postures
from mhsb_planner.motion.s3_coasting import Coasting
from mhsb_planner.motion.s3_steered import Steering
from mhsb_planner.motion.s3_trajectory import TrajectoryKind
from mhsb_planner.motion.s4_mode_schedule import StartModes
from mhsb_planner.planners.options import PlanOptions
from mhsb_planner.search.area_shortfall import AreaTerm
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_planner.search.lower_bound import ENERGY_ALONE, with_others
from mhsb_planner.search.s2_graph import StepGraph
from mhsb_planner.search.search_time import SearchTime


class Meanwhile(NamedTuple):
    """What others move beside the arm in its plane: they take oil [m³], and the time [s] at least,
    which counts for the bounds on energy."""

    oil: float
    time: float


NOTHING_ELSE = Meanwhile(0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Task:
    """What is asked for.

    goal   (x, z) m; of the whole arm in `base_link`, where joint 1 slews (x, y, z) m
    modes  in force at the start
    brake  how a moving start comes to rest: by coasting, where its plan ends, on its old way
    departure  posture at rest from which the path begins [rad]
    area   weight of the polytope's area, and the area that counts as full
    meanwhile  what moves beside the joints of the graph
    """

    goal: Position
    start: MotionState
    modes: StartModes
    brake: Trajectory | Coasting | Steering | None
    departure: FloatArray
    options: PlanOptions
    area: AreaTerm
    meanwhile: Meanwhile = NOTHING_ELSE

    @property
    def in_plane(self) -> tuple[float, float]:
        """The goal (x, z) m of a task in the plane."""
        x, z = self.goal
        return x, z

    def bound(self, graph: StepGraph) -> float:
        """No plan from the start to one of the goal's points, in the graph's plane, takes less
        energy [J]."""
        machine, options = graph.machine, self.options
        goals = goal_postures(
            machine, *self.in_plane, options.goal_psi, region=options.goal_region
        )
        start = machine.cylinder_lengths(self.start.position)
        circuit = with_others(graph.circuit, *self.meanwhile)
        return least_cost_to(machine, circuit, start, goals, ENERGY_ALONE)

    def from_rest(self, path: DiscretePath) -> Task:
        """The same asked from where a path ends, at rest and in its last modes."""
        last = path.modes[-1] if path.steps > 0 else path.start_modes
        start = MotionState.at_rest(path.posture[-1])
        modes = StartModes.settled(last)
        return replace(self, start=start, modes=modes, brake=None, departure=start.position)


class Candidate(NamedTuple):
    """A path that a motion may follow.

    compared    whether it is another planner's
    trajectory  how S3 begins on it, unless it is told; None: as the planner does
    """

    path: DiscretePath
    compared: bool = False
    trajectory: TrajectoryKind | None = None


class PathPlanner(Protocol):
    """A way of planning; its paths are made motions, of which the cheapest is the plan.

    name         by which it is asked for
    summary      where postures come from, for people: a clause that follows its name
    trajectory   how S3 begins unless it is told
    weighs_area  whether w₄ may be above 0
    rivals       other planners, with whose motions its own are compared, the quickest first
    takes        of the options that not all planners look at, those that it does: `search`,
                 `heuristic_scale`, `initial_j3`
    """

    name: str
    summary: str
    trajectory: TrajectoryKind
    weighs_area: bool
    rivals: tuple[PathPlanner, ...]
    takes: tuple[str, ...]

    def paths(
        self, graph: StepGraph, task: Task, time: SearchTime
    ) -> Iterator[Candidate]:
        """Paths from the task's departure to its goal: the first soon, then cheaper ones.

        graph  the machine, its posture table and the steps between the table's postures
        time   to be looked at every millisecond or so; when it is over, what there is by then is
               given, and nothing more

        Whoever asks may stop asking at any time. All paths state lower bounds that hold for every
        plan of this planner. Raises MhsbError where there is no path or none in time.
        """

    def warm_up(self, graph: StepGraph) -> None:
        """Compile what paths run through."""


def in_both_ways(path: Candidate, rival: PathPlanner, task: Task) -> Iterator[Candidate]:
    """A rival's path, to be made a motion in the way of who compares and, unless that is told, in
    the rival's own."""
    yield path
    if task.options.trajectory is None:
        yield path._replace(trajectory=rival.trajectory)
