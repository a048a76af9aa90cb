"""A node that sends goals and keeps all messages of the suite as bytes for later evaluation."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from geometry_msgs.msg import PoseStamped
from rclpy.qos import QoSProfile

from mhsb_msgs_py import endpoints, stamps, topics
from mhsb_msgs_py.topics import Topic
from mhsb_planner.ros.goal_sender import GoalSender
from mhsb_tools.recording import bag_format
from mhsb_tools.recording.bag_format import BagTopic
from mhsb_tools.recording.bag_writer import BagWriter
from mhsb_tools.recording.recording import RecordedMessage, Recording, decode_recording

WATCHED_TOPICS = (
    topics.GOAL_POSE,
    topics.PLAN_STATUS,
    topics.JOINT_STATES,
    topics.REFERENCE,
    topics.PLAN_IN_FORCE,
    topics.JOINT_TRAJECTORY,
    topics.MODE_COMMANDS,
    topics.DIAGNOSTICS,
)
"""Topics by which goals and motions can be judged; messages are decoded only when they are needed.
"""

RECEIVE_DEPTH = 1000
"""Messages of a topic that may wait while the watcher gets no processor time."""


class MessageWatcher(GoalSender):
    """Goal sender that also keeps the serialized messages of the suite.

    Attributes:
        kept_messages: For each topic its messages in order of arrival, as pairs: sender's time
            stamp by the system clock [ns], serialized message.
    """

    def __init__(self) -> None:
        """Make the node and subscribe to all WATCHED_TOPICS."""
        super().__init__()
        self.kept_messages: dict[Topic, list[tuple[int, bytes]]] = {
            topic: [] for topic in WATCHED_TOPICS
        }
        for topic in WATCHED_TOPICS:
            self._subscribe(topic)

    def decode_messages(self, slews: bool = False) -> Recording:
        """Decode all kept messages.

        Args:
            slews: Whether the arm slews, so that goals have a y coordinate.

        Raises:
            BagError: No joint states were received, so no simulator was running.
        """
        return decode_recording(self._messages, "what was heard", slews=slews)

    def _messages(self) -> Iterator[RecordedMessage]:
        """Yield all kept messages, topic by topic and in order of arrival.

        Yields:
            Each message with the time at which it was sent as its log time.
        """
        for topic, messages in self.kept_messages.items():
            for time_ns, data in messages:
                yield RecordedMessage(topic, topic.type_name, time_ns, data)

    def write(self, folder: Path) -> None:
        """Write all kept messages as a rosbag2 folder.

        Log time and publish time of each message are both the time at which it was sent.

        Args:
            folder: Folder of the recording; it must be empty or missing.

        Raises:
            BagError: The folder is not empty or cannot be written.
        """
        with BagWriter(folder) as bag:
            for topic, messages in self.kept_messages.items():
                name = self.resolve_topic_name(topic.name)
                bag.add_topic(BagTopic(name, topic.type_name, bag_format.format_qos(topic.qos)))
                for time_ns, data in messages:
                    bag.write(name, data, time_ns, time_ns)

    def send_message(self, message: PoseStamped) -> int:
        """Publish a goal message unchanged.

        Args:
            message: The goal pose.

        Returns:
            The stamp in its header [ns].
        """
        self._goals.publish(message)
        return stamps.from_time(message.header.stamp)

    def forget(self) -> None:
        """Discard all messages that were kept so far."""
        for messages in self.kept_messages.values():
            messages.clear()

    def _subscribe(self, topic: Topic) -> None:
        """Subscribe to a topic and append each message to `kept_messages`.

        Args:
            topic: One of WATCHED_TOPICS. Its QoS is used with a queue of RECEIVE_DEPTH messages.
        """
        kept = self.kept_messages[topic]
        profile = QoSProfile(
            history=topic.qos.history,
            depth=RECEIVE_DEPTH,
            reliability=topic.qos.reliability,
            durability=topic.qos.durability,
        )

        def received(data: bytes, info: dict[str, Any]) -> None:
            """Append a serialized message and its source time stamp [ns] to the topic's list.

            Args:
                data: Serialized message.
                info: Message info of rclpy; only `source_timestamp` is used.
            """
            kept.append((info["source_timestamp"], data))

        endpoints.make_subscription(self, topic, received, profile, raw=True)
