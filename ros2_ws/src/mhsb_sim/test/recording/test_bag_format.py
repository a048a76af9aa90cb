"""Types and metadata of a recording, against what the middleware itself says."""

from __future__ import annotations

import pytest
import rclpy
import yaml

from mhsb_msgs_py import qos, topics
from mhsb_sim.recording import bag_format


def test_type_hashes_are_those_of_the_middleware(ros_context, eventually):
    node = rclpy.create_node("hashes", context=ros_context)
    for topic in topics.SUITE_TOPICS:
        node.create_publisher(topic.message, topic.name, topic.qos)
    for topic in topics.SUITE_TOPICS:
        name = node.resolve_topic_name(topic.name)
        eventually(lambda name=name: node.get_publishers_info_by_topic(name))
        [publisher] = node.get_publishers_info_by_topic(name)
        assert publisher.topic_type == topic.type_name
        assert str(publisher.topic_type_hash) == bag_format.type_hash(topic.type_name)
    node.destroy_node()


def test_a_definition_holds_the_types_that_it_contains():
    text = bag_format.definition("sensor_msgs/msg/JointState")
    assert "float64[] position" in text
    assert "MSG: std_msgs/Header" in text
    assert "MSG: builtin_interfaces/Time" in text


@pytest.mark.parametrize(
    ("profile", "reliability", "durability", "depth"),
    [
        (qos.DEFAULT, "reliable", "volatile", 10),
        (qos.LATCHED, "reliable", "transient_local", 1),
        (qos.CLOCK, "best_effort", "volatile", 1),
    ],
)
def test_qos_is_written_in_the_words_of_rosbag2(profile, reliability, durability, depth):
    [written] = yaml.safe_load(bag_format.qos_text(profile))
    assert written["reliability"] == reliability
    assert written["durability"] == durability
    assert written["depth"] == depth
    assert "&" not in bag_format.qos_text(profile)
