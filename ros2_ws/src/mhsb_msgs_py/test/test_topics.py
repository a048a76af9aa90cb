"""Names and QoS as the contract lists them, seen from the middleware."""

from __future__ import annotations

import pytest
import rclpy
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from mhsb_msgs_py import names, topics

CONTRACT = {
    "goal_pose": ("PoseStamped", False, 100),
    "plan_status": ("DiagnosticArray", False, 100),
    "joint_states": ("JointState", False, 10),
    "reference": ("JointTrajectory", False, 10),
    "plan_in_force": ("Time", True, 1),
    "joint_trajectory": ("JointTrajectory", False, 10),
    "mode_commands": ("JointTrajectory", False, 10),
    "modes": ("UInt8MultiArray", True, 1),
    "actuator_states": ("JointState", False, 10),
    "estimates": ("JointState", False, 10),
    "planned_path": ("Path", True, 1),
    "work_plane/planned_path": ("Path", True, 1),
    "markers": ("MarkerArray", True, 1),
    "robot_description": ("String", True, 1),
    "/diagnostics": ("DiagnosticArray", False, 10),
}


@pytest.mark.parametrize("topic", topics.SUITE_TOPICS, ids=lambda topic: topic.name)
def test_a_topic_has_the_type_and_qos_of_the_contract(topic):
    if topic is topics.CLOCK:
        return_type = (topic.message.__name__, topic.qos.reliability)
        assert return_type == ("Clock", ReliabilityPolicy.BEST_EFFORT)
        return
    message, latched, depth = CONTRACT[topic.name]
    assert topic.message.__name__ == message
    assert topic.qos.reliability is ReliabilityPolicy.RELIABLE
    assert (topic.qos.durability is DurabilityPolicy.TRANSIENT_LOCAL) == latched
    assert topic.qos.depth == depth


def test_a_late_subscriber_sees_what_was_latched(ros_context, eventually):
    node = rclpy.create_node("latch", context=ros_context)
    executor = rclpy.executors.SingleThreadedExecutor(context=ros_context)
    executor.add_node(node)
    topic = topics.PLAN_IN_FORCE
    node.create_publisher(topic.message, topic.name, topic.qos).publish(topic.message(sec=4))
    seen = []
    node.create_subscription(topic.message, topic.name, seen.append, topic.qos)

    def spun() -> bool:
        executor.spin_once(timeout_sec=0.05)
        return bool(seen)

    eventually(spun)
    assert seen[0].sec == 4
    executor.shutdown()
    node.destroy_node()


def test_joints_and_actuators_are_numbered_from_one():
    assert names.joint_names(3) == ("joint_1", "joint_2", "joint_3")
    assert names.actuator_names(2) == ("actuator_1", "actuator_2")
