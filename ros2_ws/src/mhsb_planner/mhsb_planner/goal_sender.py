"""A node that sends goals and keeps what the planner says of them; for commands and tests."""

from __future__ import annotations

import os
import time

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from mhsb_msgs_py import goal_pose, plan_status, topics
from mhsb_msgs_py.errors import MessageError
from mhsb_msgs_py.goal_pose import Goal
from mhsb_msgs_py.plan_status import ExecutionReport, GoalVerdict


class GoalSender(Node):
    """Publishes goals and keeps what the planner says of them."""

    def __init__(self) -> None:
        super().__init__(f"mhsb_goal_{os.getpid()}")
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
        return (
            self._goals.get_subscription_count() > 0
            and self._status.get_publisher_count() > 0
        )

    def send(self, x: float, z: float) -> int:
        """Publish a goal (x, z) m in base_link; returns its stamp, a new one each time [ns]."""
        stamp_ns = time.time_ns()
        self._goals.publish(goal_pose.encode(Goal(stamp_ns, x, z)))
        return stamp_ns

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
