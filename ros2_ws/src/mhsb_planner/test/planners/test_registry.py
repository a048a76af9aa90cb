"""The planners there are, and that another is added by one file and one registration."""

from collections.abc import Iterator

import numpy as np
import pytest
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

from mhsb_model.errors import MhsbError
from mhsb_model.trajectory import MotionState
from mhsb_planner.errors import NoPathError, RequestError
from mhsb_planner.planner import DEFAULT_PLANNER, Planner, PlanOptions, warm_up
from mhsb_planner.planners.path_planner import PathProposal, PathRequest
from mhsb_planner.planners.registry import (
    PLANNER_KINDS,
    REGISTERED_PLANNERS,
    get_planner,
    planner_summaries,
)
from mhsb_planner.planners.table import yield_graph_paths
from mhsb_planner.progress import PlanProgress
from mhsb_planner.ros import planner_parameters
from mhsb_planner.search.s2_graph import StepGraph


class DetourPlanner:
    """By way of a point of the posture table, and then straight there."""

    name = "detour"
    summary = "takes the scenic route"
    trajectory = "followed"
    weighs_area = False
    baselines = ()
    takes = ()

    def __init__(self) -> None:
        self.asked = 0

    def paths(
        self, graph: StepGraph, request: PathRequest, progress: PlanProgress
    ) -> Iterator[PathProposal]:
        """A path that costs too much, something impossible, then the table's."""
        self.asked += 1
        [path] = yield_graph_paths(graph, request, progress)
        again = np.concatenate([np.arange(path.steps), [path.steps - 1]])
        yield PathProposal(longer(path, again))
        assert progress.has_motion
        yield PathProposal(path)
        raise NoPathError(request.goal, request.goal)

    def warm_up(self, graph: StepGraph) -> None:
        """Nothing to compile."""
        self.asked -= 1


def longer(path, steps):
    """The path with its last step walked there, back and there again."""
    ends = np.concatenate([np.arange(path.steps + 1), [path.steps - 1, path.steps]])
    walked = np.concatenate([steps, [path.steps - 1]])
    return type(path)(
        tip=path.tip[ends],
        posture=path.posture[ends],
        modes=path.modes[walked],
        duration=path.duration[walked],
        energy=path.energy[walked],
        energy_series=path.energy_series[walked],
        cost=path.cost,
        start_modes=path.start_modes,
        statistics=path.statistics,
    )


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch) -> DetourPlanner:
    toy = DetourPlanner()
    monkeypatch.setitem(REGISTERED_PLANNERS, toy.name, toy)
    return toy


def test_one_registration_makes_a_planner_plan(machine, table, toy):
    planner = Planner(machine, table)
    start = MotionState.at_rest(table.posture[planner.graph.grid.node_at(0.55, -0.05), 0])
    plan = planner.plan((0.55, 0.3), start, options=PlanOptions(planner="detour"))
    known = planner.plan(
        (0.55, 0.3), start, options=PlanOptions(planner="table", trajectory="followed")
    )
    assert toy.asked == 1
    assert np.array_equal(plan.motion.trajectory.position, known.motion.trajectory.position)
    with pytest.raises(RequestError, match="must be 0 for the planner 'detour'"):
        planner.plan((0.55, 0.3), start, options=PlanOptions(planner="detour", area_weight=1.0))


def test_one_registration_makes_it_known_to_warm_up_and_help(machine, table, toy):
    warm_up(Planner(machine, table))
    assert toy.asked == -1
    assert "detour takes the scenic route" in planner_summaries()


def test_one_registration_makes_it_a_value_of_the_node_s_parameter(
    ros_context: Context, machine, toy
):
    node = Node("with_a_toy", context=ros_context)
    planner_parameters.declare_changeable(node, machine)
    change = Parameter("planner", value="detour")
    assert planner_parameters.find_refusal(node, machine, [change]) is None
    node.set_parameters([change])
    assert planner_parameters.read_settings(node, machine).options.planner == "detour"
    assert "scenic" in node.describe_parameter("planner").description
    weight = Parameter("area_weight", value=1.0)
    assert "needs planner 'integrated'" in planner_parameters.find_refusal(node, machine, [weight])
    node.destroy_node()


def test_a_planner_that_is_not_there_is_refused_with_those_that_are(machine, table):
    with pytest.raises(RequestError, match=f"must be one of: {', '.join(PLANNER_KINDS)}"):
        get_planner("guess")
    start = MotionState.at_rest(table.posture[table.feasible][0, 0])
    with pytest.raises(RequestError, match="planner must be one of"):
        Planner(machine, table).plan((0.5, 0.1), start, options=PlanOptions(planner="guess"))


def test_each_planner_is_registered_by_its_own_name():
    assert PLANNER_KINDS[:3] == ("table", "fixed", "integrated")
    assert PlanOptions().planner == DEFAULT_PLANNER == "integrated"
    assert all(planner.name == name for name, planner in REGISTERED_PLANNERS.items())


@pytest.mark.parametrize("kind", PLANNER_KINDS)
@pytest.mark.parametrize(
    ("goal", "state", "named"),
    [
        ((np.nan, 0.1), {}, "goal"),
        ((0.5, np.inf), {}, "goal"),
        ((0.5, 0.1), {"position": [0.1, np.nan, 0.1]}, "start position"),
        ((0.5, 0.1), {"velocity": [0.1, 0.1, -np.inf]}, "start velocity"),
        ((0.5, 0.1), {"acceleration": [np.nan, 0.0, 0.0]}, "start acceleration"),
        ((0.5, 0.1), {"position": [0.1, 0.1]}, "start position"),
    ],
)
def test_what_is_not_finite_is_refused_by_name(machine, planner, kind, goal, state, named):
    values = {"position": planner.graph.layout.posture[0], **{k: np.zeros(3) for k in OTHERS}}
    start = MotionState(**{**values, **{k: np.array(v) for k, v in state.items()}})
    with pytest.raises(RequestError, match=f"^{named} must be"):
        planner.plan(goal, start, options=PlanOptions(planner=kind))


@pytest.mark.parametrize("psi", [np.nan, np.inf])
def test_an_angle_at_the_goal_that_is_not_finite_is_refused(psi):
    with pytest.raises(RequestError, match="goal_psi must be a finite angle"):
        PlanOptions(goal_psi=psi)


OTHERS = ("velocity", "acceleration")


@pytest.fixture(scope="module")
def planner(machine, table) -> Planner:
    return Planner(machine, table)


def test_a_planner_s_own_error_is_told_where_there_is_no_motion(machine, table, toy):
    heavy = Planner(machine.changed(payload=200.0), table)
    start = MotionState.at_rest(table.posture[heavy.graph.grid.node_at(0.8, -0.3), 0])
    with pytest.raises(MhsbError, match="no sequence of admissible steps"):
        heavy.plan((0.8, 0.3), start, options=PlanOptions(planner="detour"))
