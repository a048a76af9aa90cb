"""Types and metadata of a recording, against what the middleware itself says."""

from __future__ import annotations

import pytest
import rclpy
import yaml

from mhsb_msgs_py import qos, topics
from mhsb_tools.recording import bag_format
from mhsb_tools.recording.bag_format import BagContents, BagTopic


def test_type_hashes_are_those_of_the_middleware(ros_context, eventually):
    node = rclpy.create_node("hashes", context=ros_context)
    for topic in topics.SUITE_TOPICS:
        node.create_publisher(topic.message, topic.name, topic.qos)
    for topic in topics.SUITE_TOPICS:
        name = node.resolve_topic_name(topic.name)
        eventually(lambda name=name: node.get_publishers_info_by_topic(name))
        [publisher] = node.get_publishers_info_by_topic(name)
        assert publisher.topic_type == topic.type_name
        assert str(publisher.topic_type_hash) == bag_format.compute_type_hash(topic.type_name)
    node.destroy_node()


def test_a_definition_holds_the_types_that_it_contains():
    text = bag_format.get_type_definition("sensor_msgs/msg/JointState")
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
    [written] = yaml.safe_load(bag_format.format_qos(profile))
    assert written["reliability"] == reliability
    assert written["durability"] == durability
    assert written["depth"] == depth
    assert "&" not in bag_format.format_qos(profile)


@pytest.mark.parametrize("word", ["nsec", "depth", "lifespan", "liveliness: ", "sec: 9"])
def test_qos_of_a_damaged_recording_that_lacks_a_key_is_left_out_of_its_metadata(tmp_path, word):
    text = bag_format.format_qos(qos.DEFAULT)
    for written, count in ((text, 1), (text.replace(word, f"x{word}", 1), 0)):
        topic = BagTopic("/goal_pose", "geometry_msgs/msg/PoseStamped", written)
        contents = BagContents(1, 2, ((topic, 1),))
        bag_format.write_metadata(tmp_path, {"bag.mcap": contents})
        metadata = yaml.safe_load((tmp_path / "metadata.yaml").read_text(encoding="utf-8"))
        [described] = metadata[bag_format.METADATA_KEY]["topics_with_message_count"]
        assert len(described["topic_metadata"]["offered_qos_profiles"]) == count
