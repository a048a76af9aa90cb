"""Simulator and planner as child processes, and the first word with them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from rclpy.executors import SingleThreadedExecutor

from mhsb_model.errors import MhsbError
from mhsb_model.kernels.pool import compile_ahead
from mhsb_msgs_py.names import PLANNER_NODE, SIM_NODE
from mhsb_msgs_py.node_process import spin_until
from mhsb_planner import kernel_parts as planner_kernels
from mhsb_planner.ros.goal_sender import GoalSender
from mhsb_sim.live.child_process import ChildEndedError, ChildProcess
from mhsb_sim.simulation import kernel_parts as simulator_kernels

SIM_EXECUTABLE = ("mhsb_sim", "sim_node")
PLANNER_EXECUTABLE = ("mhsb_planner", "planner_node")

START_TIMEOUT = 180.0
"""Time for both nodes to be ready; the first start compiles and builds the posture table [s]."""

ANSWER_TIMEOUT = 10.0  # s
DISCOVERY = 1.0
"""Time to hear of nodes that run already [s]."""


def refuse_company(sender: GoalSender, executor: SingleThreadedExecutor) -> None:
    """Other nodes of the suite in the same domain would answer, and move, in our stead."""
    spin_until(executor, lambda: False, DISCOVERY)
    running = {PLANNER_NODE, SIM_NODE} & set(sender.get_node_names())
    if running:
        raise MhsbError(
            f"{' and '.join(sorted(running))} runs in this ROS domain already; end it or set "
            "ROS_DOMAIN_ID to another number"
        )


def compile_nodes() -> None:
    """Have all kernels of both nodes compiled on all processors, before either starts."""
    parts = (*planner_kernels.PARTS, *simulator_kernels.PARTS)
    compile_ahead(parts, lambda line: print(line, flush=True))


@contextmanager
def both_nodes(
    sim_settings: tuple[str, ...] = (), planner_settings: tuple[str, ...] = ()
) -> Iterator[tuple[ChildProcess, ChildProcess]]:
    """Simulator and planner, ready, for the length of a block; settings are `NAME:=VALUE`."""
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
    """Command-line arguments that set parameters `NAME:=VALUE`."""
    given = [word for setting in settings for word in ("-p", setting)]
    return ["--ros-args", *given] if given else []


def shake_hands(sender: GoalSender, executor: SingleThreadedExecutor) -> None:
    """Wait until the planner has answered once, to a goal that nothing comes of.

    A match is known to each side on its own; after this, goals are heard and verdicts, too.
    """
    matched = spin_until(executor, lambda: sender.matched, ANSWER_TIMEOUT)
    if not matched or sender.ask(executor, (math.nan, math.nan), ANSWER_TIMEOUT) is None:
        raise ChildEndedError("the planner is ready, but cannot be reached over ROS")
