"""Doubles on the ROS graph, among nodes of one process."""

from __future__ import annotations

import pytest
import rclpy
from std_msgs.msg import String

from mhsb_msgs_py.endpoints import describe_duplicates


@pytest.fixture
def make(ros_context):
    """Function (name, namespace, topic) that makes a node with one publisher."""
    nodes = []

    def run(name: str, topic: str, namespace: str = ""):
        node = rclpy.create_node(name, namespace=namespace, context=ros_context)
        nodes.append(node)
        return node, node.create_publisher(String, topic, 10)

    yield run
    for node in nodes:
        node.destroy_node()


def test_a_node_alone_has_no_problem_and_others_may_have_other_names_and_topics(make, eventually):
    node, publisher = make("arm", "reference")
    make("leg", "reference_of_leg")
    make("arm", "reference", namespace="/left")
    eventually(lambda: node.count_publishers("/left/reference") == 1)
    assert describe_duplicates(node, [publisher]) == ""


def test_a_second_node_of_the_same_name_is_told(make, eventually):
    node, publisher = make("arm", "reference", namespace="/left")
    make("arm", "another", namespace="/left")
    eventually(lambda: describe_duplicates(node, [publisher]) != "")
    assert describe_duplicates(node, [publisher]).startswith(
        "there are 2 nodes called /left/arm; one is allowed: end the others"
    )


def test_a_second_publisher_of_a_topic_is_told_until_it_is_gone(make, eventually):
    node, publisher = make("arm", "reference")
    other, second = make("impostor", "/reference")
    eventually(lambda: describe_duplicates(node, [publisher]) != "")
    assert "/reference has 2 publishers; one is allowed" in describe_duplicates(node, [publisher])
    other.destroy_publisher(second)
    eventually(lambda: describe_duplicates(node, [publisher]) == "")
