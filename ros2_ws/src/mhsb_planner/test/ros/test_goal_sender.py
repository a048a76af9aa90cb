"""Goals are sent only once a planner receives them."""

from __future__ import annotations

from rclpy.node import Node

from mhsb_msgs_py import topics
from mhsb_msgs_py.node_process import run_command_node, spin_until
from mhsb_planner.ros.goal_sender import GoalSender

GOAL, STATUS = topics.GOAL_POSE, topics.PLAN_STATUS


def test_a_recorder_beside_a_planner_that_is_not_ready_is_no_planner():
    with run_command_node(GoalSender) as (executor, sender):
        recorder, planner = Node("recorder"), Node("planner")
        try:
            recorder.create_subscription(GOAL.message, GOAL.name, lambda _: None, GOAL.qos)
            planner.create_publisher(STATUS.message, STATUS.name, STATUS.qos)
            assert spin_until(executor, lambda: sender.subscriber_count > 0, 10.0)
            assert not sender.wait_for_planner(executor, 1.0)
            planner.create_subscription(GOAL.message, GOAL.name, lambda _: None, GOAL.qos)
            assert sender.wait_for_planner(executor, 10.0)
            assert sender.subscriber_count == 2
        finally:
            recorder.destroy_node()
            planner.destroy_node()
