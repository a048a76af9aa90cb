"""A node that sends goals and keeps what the planner says of them; for commands and tests."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient

from mhsb_model.goal import Goal
from mhsb_model.types import Position
from mhsb_model.verdict import ExecutionReport, GoalVerdict
from mhsb_msgs_py import goal_pose, names, plan_status, topics
from mhsb_msgs_py.errors import MessageError
from mhsb_msgs_py.node_process import spin_until

SEND_AGAIN_AFTER = 3.0
"""Time without an answer after which a goal is sent anew [s]; longer than a planner lets it wait.

A match is known to each side on its own: the first message may still meet deaf ears."""


class GoalSender(Node):
    """Publishes goals and keeps what the planner says of them."""

    def __init__(self, name: str = "mhsb_goal") -> None:
        """A node of this name and the process's number, since there may be several."""
        super().__init__(f"{name}_{os.getpid()}")
        goal, status = topics.GOAL_POSE, topics.PLAN_STATUS
        self._goals = self.create_publisher(goal.message, goal.name, goal.qos)
        self._status = self.create_subscription(
            status.message, status.name, self._on_status, status.qos
        )
        self.verdicts: dict[int, GoalVerdict] = {}
        self.executions: dict[int, ExecutionReport] = {}

    @property
    def matched(self) -> bool:
        """Whether a planner listens to goals and its verdicts can be heard."""
        return self.listeners > 0 and self._status.get_publisher_count() > 0

    @property
    def listeners(self) -> int:
        """How many subscribers hear goals."""
        return int(self._goals.get_subscription_count())

    def send(self, *place: float) -> int:
        """Publish a goal [m] in base_link; returns its stamp, a new one each time [ns]."""
        stamp_ns = time.time_ns()
        self._goals.publish(goal_pose.encode(Goal.at(stamp_ns, place)))
        return stamp_ns

    def ask(
        self, executor: SingleThreadedExecutor, place: Position, timeout: float
    ) -> GoalVerdict | None:
        """Send a goal until the planner answers; its verdict, or None after `timeout` s."""
        end = time.monotonic() + timeout
        while (left := end - time.monotonic()) > 0:
            stamp_ns = self.send(*place)
            answered = partial(self.verdicts.__contains__, stamp_ns)
            if spin_until(executor, answered, min(left, SEND_AGAIN_AFTER)):
                return self.verdicts[stamp_ns]
        return None

    def set_at_planner(
        self, executor: SingleThreadedExecutor, values: Mapping[str, Any], timeout: float
    ) -> str | None:
        """Set parameters of the planner; why it refused them, or None where they are set.

        Raises TimeoutError where it does not answer within `timeout` s.
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
