"""Simulator and planner as child processes, and the check that the planner answers."""

import math
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from rclpy.executors import SingleThreadedExecutor

from mhsb_model.errors import MhsbError
from mhsb_msgs_py.names import PLANNER_NODE, SIM_NODE
from mhsb_msgs_py.node_process import spin_until
from mhsb_planner.ros.goal_sender import GoalSender
from mhsb_tools.live.child_process import ChildEndedError, ChildProcess

SIM_EXECUTABLE = ("mhsb_sim", "sim_node")
"""Package and executable of the simulator node."""
PLANNER_EXECUTABLE = ("mhsb_planner", "planner_node")
"""Package and executable of the planner node."""

START_TIMEOUT = 180.0
"""Longest wait for each node to be ready [s]; a first start compiles and builds the posture table.
"""

ANSWER_TIMEOUT = 10.0
"""Longest wait for the match with the planner, and then for its verdict [s]."""

DISCOVERY_TIME = 1.0
"""Time in which nodes that already run are discovered [s]."""


def check_no_other_nodes(sender: GoalSender, executor: SingleThreadedExecutor) -> None:
    """Raise MhsbError if a planner node or simulator node already runs in this ROS domain.

    Such a node would receive the goals and move its own arm. The check takes DISCOVERY_TIME: the
    executor spins that long, so that other nodes are discovered.

    Args:
        sender: Node of this process; its list of node names in the ROS graph is read.
        executor: Executor that serves `sender`.

    Raises:
        MhsbError: A planner or simulator runs; the message names it.
    """
    spin_until(executor, lambda: False, DISCOVERY_TIME)
    running = {PLANNER_NODE, SIM_NODE} & set(sender.get_node_names())
    if running:
        raise MhsbError(
            f"{' and '.join(sorted(running))} runs in this ROS domain already; end it or set "
            "ROS_DOMAIN_ID to another number"
        )


@contextmanager
def run_both_nodes(
    sim_settings: tuple[str, ...] = (), planner_settings: tuple[str, ...] = ()
) -> Iterator[tuple[ChildProcess, ChildProcess]]:
    """Run simulator node and planner node as child processes while a `with` block lasts.

    Context manager. The block begins when both nodes have printed "ready". Both processes are ended
    after the block, also if it raises an error.

    Args:
        sim_settings: ROS parameters of the simulator node, each as `NAME:=VALUE`.
        planner_settings: ROS parameters of the planner node, each as `NAME:=VALUE`.

    Yields:
        The simulator process and the planner process.

    Raises:
        ChildEndedError: A node ended, or was not ready within START_TIMEOUT.
    """
    with ExitStack() as stack:
        simulator, planner = (
            stack.enter_context(ChildProcess(*executable, *ros_arguments(settings)))
            for executable, settings in (
                (SIM_EXECUTABLE, sim_settings),
                (PLANNER_EXECUTABLE, planner_settings),
            )
        )
        for process in (simulator, planner):
            process.wait_for("ready", START_TIMEOUT)
        yield simulator, planner


def ros_arguments(settings: tuple[str, ...]) -> list[str]:
    """Return command-line arguments that set ROS parameters.

    Args:
        settings: Parameters, each as `NAME:=VALUE`.

    Returns:
        `--ros-args -p NAME:=VALUE ...`; an empty list if there are no settings.
    """
    given = [word for setting in settings for word in ("-p", setting)]
    return ["--ros-args", *given] if given else []


def wait_for_planner_answer(sender: GoalSender, executor: SingleThreadedExecutor) -> None:
    """Wait until the planner node has answered a test goal.

    Discovery of publishers and subscribers completes separately in each process, so a match does
    not prove that messages arrive. The test goal has NaN coordinates, so the planner refuses it and
    the arm does not move.

    Args:
        sender: Node that sends the goal and receives the verdict.
        executor: Executor that serves `sender`.

    Raises:
        ChildEndedError: The planner's topics were not matched within ANSWER_TIMEOUT, or no verdict
            came within a further ANSWER_TIMEOUT.
    """
    matched = spin_until(executor, lambda: sender.is_matched, ANSWER_TIMEOUT)
    if (
        not matched
        or sender.request_verdict(executor, (math.nan, math.nan), ANSWER_TIMEOUT) is None
    ):
        raise ChildEndedError("the planner is ready, but cannot be reached over ROS")
