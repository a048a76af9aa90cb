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


def test_a_recorder_that_is_found_after_the_planner_receives_the_goal_too():
    with run_command_node(GoalSender) as (executor, sender):
        recorder, planner = Node("recorder"), Node("planner")
        received = []
        try:
            planner.create_publisher(STATUS.message, STATUS.name, STATUS.qos)
            planner.create_subscription(GOAL.message, GOAL.name, lambda _: None, GOAL.qos)
            assert spin_until(executor, lambda: sender.is_matched, 10.0)

            def subscribe() -> None:
                timer.cancel()
                recorder.create_subscription(GOAL.message, GOAL.name, received.append, GOAL.qos)

            timer = sender.create_timer(0.1, subscribe)
            executor.add_node(recorder)
            assert sender.wait_for_planner(executor, 10.0)
            sender.send(0.5, 0.5)
            assert spin_until(executor, lambda: bool(received), 10.0)
        finally:
            recorder.destroy_node()
            planner.destroy_node()
