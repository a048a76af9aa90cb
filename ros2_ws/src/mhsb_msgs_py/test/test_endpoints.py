"""Endpoints of the suite's topics: they meet as any others, and leave the executor little to do."""

from __future__ import annotations

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSDurabilityPolicy
from std_msgs.msg import String

from mhsb_msgs_py import endpoints, topics
from mhsb_msgs_py.node_process import spin_until
from mhsb_msgs_py.topics import Topic


@pytest.fixture
def node(ros_context):
    made = rclpy.create_node("arm", context=ros_context)
    yield made
    made.destroy_node()


def test_a_subscription_has_its_topics_qos_unless_another_is_given(node):
    topic = topics.ROBOT_DESCRIPTION
    own = endpoints.make_subscription(node, topic, print)
    other = endpoints.make_subscription(node, topic, print, topics.REFERENCE.qos)
    assert own.qos_profile.durability is QoSDurabilityPolicy.TRANSIENT_LOCAL
    assert other.qos_profile.durability is QoSDurabilityPolicy.VOLATILE


def test_a_message_arrives(node, ros_context):
    topic, heard = Topic("named", String, topics.ROBOT_DESCRIPTION.qos), []
    endpoints.make_publisher(node, topic).publish(String(data="here"))
    endpoints.make_subscription(node, topic, heard.append)
    executor = SingleThreadedExecutor(context=ros_context)
    executor.add_node(node)
    assert spin_until(executor, lambda: heard, 10.0)
    executor.shutdown()
    assert heard[0].data == "here"


def test_no_endpoint_adds_to_what_the_executor_looks_at(node):
    before = len(list(node.waitables))
    endpoints.make_publisher(node, topics.REFERENCE)
    endpoints.make_subscription(node, topics.REFERENCE, print)
    assert len(list(node.waitables)) == before
