"""Node that sends goals and collects the planner's reports on them, for commands and tests."""

import os
import time
from collections.abc import Iterable, Mapping
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.topic_endpoint_info import TopicEndpointInfo

from mhsb_model.goal import Goal
from mhsb_model.types import Position
from mhsb_model.verdict import ExecutionReport, GoalVerdict
from mhsb_msgs_py import goal_pose, names, plan_status, topics
from mhsb_msgs_py.errors import MessageError
from mhsb_msgs_py.node_process import spin_until

SEND_AGAIN_AFTER = 3.0
"""Time without an answer after which a goal is sent again [s].

A planner lets a goal wait for a shorter time. The first message may be lost if the planner is not
connected yet.
"""

DISCOVERY_TIME = 0.5
"""Time to wait for other subscribers of goals after a planner is found [s].

A planner is usually found after 0.1 s. On a busy computer, a recorder is found later and would miss
the goal.
"""


def _collect_node_names(endpoints: Iterable[TopicEndpointInfo]) -> set[tuple[str, str]]:
    """Return namespace and name of each node to which publishers or subscribers belong."""
    return {(each.node_namespace, each.node_name) for each in endpoints}


class GoalSender(Node):
    """Node that sends goals and collects the planner's reports on them.

    Attributes:
        verdicts: Verdicts by the stamp of their goal [ns].
        executions: Execution reports by the stamp of their goal [ns].
    """

    def __init__(self, name: str = "mhsb_goal") -> None:
        """Create a node that publishes goals and subscribes to the planner's status.

        Args:
            name: First part of the node's name. The process id is appended, so that several such
                nodes can run at the same time.
        """
        super().__init__(f"{name}_{os.getpid()}")
        goal, status = topics.GOAL_POSE, topics.PLAN_STATUS
        self._goals = self.create_publisher(goal.message, goal.name, goal.qos)
        self._status = self.create_subscription(
            status.message, status.name, self._on_status, status.qos
        )
        self.verdicts: dict[int, GoalVerdict] = {}
        self.executions: dict[int, ExecutionReport] = {}

    @property
    def is_matched(self) -> bool:
        """True if a ready planner is found, and goals and verdicts have connections.

        Only a ready planner both receives goals and publishes verdicts. A recorder only receives
        goals, and a planner that is not ready yet only publishes verdicts.
        """
        planners = self.get_publishers_info_by_topic(self._status.topic_name)
        receivers = self.get_subscriptions_info_by_topic(self._goals.topic_name)
        return (
            self.subscriber_count > 0
            and self._status.get_publisher_count() > 0
            and not _collect_node_names(planners).isdisjoint(_collect_node_names(receivers))
        )

    def wait_for_planner(self, executor: SingleThreadedExecutor, timeout: float) -> bool:
        """Wait until a planner is found and all subscribers of goals are connected.

        After a planner is found, the method waits for `DISCOVERY_TIME`, so that other subscribers
        are also found. If a subscriber cannot be connected, waiting ends after `SEND_AGAIN_AFTER`.

        Args:
            executor: Executor that serves this node.
            timeout: Longest time to wait for a planner [s].

        Returns:
            True if a planner was found in time.
        """
        end = time.monotonic() + timeout
        if not spin_until(executor, lambda: self.is_matched, timeout):
            return False
        spin_until(executor, lambda: False, DISCOVERY_TIME)
        left = min(max(0.0, end - time.monotonic()), SEND_AGAIN_AFTER)
        known = partial(self.count_subscribers, self._goals.topic_name)
        spin_until(executor, lambda: self.subscriber_count >= known(), left)
        return True

    @property
    def subscriber_count(self) -> int:
        """Number of subscribers that receive goals."""
        return int(self._goals.get_subscription_count())

    def send(self, *place: float) -> int:
        """Publish a goal whose stamp is the present system time.

        Args:
            place: Goal in `base_link`, x, z or x, y, z [m].

        Returns:
            Stamp of the goal [ns].
        """
        stamp_ns = time.time_ns()
        self._goals.publish(goal_pose.encode(Goal.at(stamp_ns, place)))
        return stamp_ns

    def request_verdict(
        self, executor: SingleThreadedExecutor, place: Position, timeout: float
    ) -> GoalVerdict | None:
        """Send a goal, and wait for the planner's verdict on it.

        Each time `SEND_AGAIN_AFTER` has passed without an answer, the goal is sent again with a new
        stamp. Only a verdict on the latest stamp is returned.

        Args:
            executor: Executor that serves this node.
            place: Goal in `base_link`, (x, z) or (x, y, z) [m].
            timeout: Longest time to wait in total [s].

        Returns:
            The verdict; None if no verdict came within `timeout`.
        """
        end = time.monotonic() + timeout
        while (left := end - time.monotonic()) > 0:
            stamp_ns = self.send(*place)
            answered = partial(self.verdicts.__contains__, stamp_ns)
            if spin_until(executor, answered, min(left, SEND_AGAIN_AFTER)):
                return self.verdicts[stamp_ns]
        return None

    def set_planner_parameters(
        self, executor: SingleThreadedExecutor, values: Mapping[str, Any], timeout: float
    ) -> str | None:
        """Set parameters of the planner node, all of them or none.

        Args:
            executor: Executor that serves this node.
            values: Values by parameter name.
            timeout: Longest time to wait for the planner and its answer, in total [s].

        Returns:
            Sentence in which the planner says why it refused the parameters; None if they are set.

        Raises:
            TimeoutError: The planner was not found or did not answer in time.
        """
        client = AsyncParameterClient(self, names.PLANNER_NODE)
        end = time.monotonic() + timeout
        if not spin_until(executor, client.services_are_ready, timeout):
            raise TimeoutError
        changes = [Parameter(name, value=value) for name, value in values.items()]
        answer = client.set_parameters_atomically(changes)
        if not spin_until(executor, answer.done, max(0.0, end - time.monotonic())):
            raise TimeoutError
        result = answer.result().result
        return None if result.successful else str(result.reason)

    def _on_status(self, message: DiagnosticArray) -> None:
        """Store the reports of a message in `verdicts` and `executions`, by stamp of their goal.

        Args:
            message: Message of `plan_status`. If it cannot be read, it is logged and dropped.
        """
        try:
            reports = plan_status.decode(message)
        except MessageError as error:
            self.get_logger().warning(f"plan_status is not understood: {error}")
            return
        for report in reports:
            if isinstance(report, GoalVerdict):
                self.verdicts[report.goal_stamp_ns] = report
            else:
                self.executions[report.goal_stamp_ns] = report
