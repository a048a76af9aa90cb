"""A node that sends goals and keeps all that is said meanwhile, as bytes, for later."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from geometry_msgs.msg import PoseStamped
from rclpy.qos import QoSProfile

from mhsb_msgs_py import endpoints, stamps, topics
from mhsb_msgs_py.topics import Topic
from mhsb_planner.ros.goal_sender import GoalSender
from mhsb_sim.recording import bag_format
from mhsb_sim.recording.bag_format import BagTopic
from mhsb_sim.recording.bag_writer import BagWriter
from mhsb_sim.recording.recording import RecordedMessage, Recording, decoded

WATCHED = (
    topics.GOAL_POSE,
    topics.PLAN_STATUS,
    topics.JOINT_STATES,
    topics.REFERENCE,
    topics.PLAN_IN_FORCE,
    topics.JOINT_TRAJECTORY,
    topics.MODE_COMMANDS,
    topics.DIAGNOSTICS,
)
"""What goals and motions can be judged by; decoding waits until there is time for it."""

RECEIVE_DEPTH = 1000
"""Messages that may wait for the watcher while others have the processor."""


class Watcher(GoalSender):
    """Keeps serialized messages with the system's time at which they were sent [ns]."""

    def __init__(self) -> None:
        super().__init__()
        self.kept: dict[Topic, list[tuple[int, bytes]]] = {topic: [] for topic in WATCHED}
        for topic in WATCHED:
            self._watch(topic)

    def recording(self, slews: bool = False) -> Recording:
        """All that has been heard, of an arm that slews or not; BagError where no simulator was."""
        return decoded(self._messages, "what was heard", slews=slews)

    def _messages(self) -> Iterator[RecordedMessage]:
        """Yield everything that has been heard, topic by topic."""
        for topic, messages in self.kept.items():
            for time_ns, data in messages:
                yield RecordedMessage(topic, topic.type_name, time_ns, data)

    def write(self, folder: Path) -> None:
        """All that has been heard, as a recording."""
        with BagWriter(folder) as bag:
            for topic, messages in self.kept.items():
                name = self.resolve_topic_name(topic.name)
                bag.add_topic(BagTopic(name, topic.type_name, bag_format.qos_text(topic.qos)))
                for time_ns, data in messages:
                    bag.write(name, data, time_ns, time_ns)

    def send_message(self, message: PoseStamped) -> int:
        """Publish a goal as it is; returns its stamp [ns]."""
        self._goals.publish(message)
        return stamps.from_time(message.header.stamp)

    def forget(self) -> None:
        """Keep what comes from now on only."""
        for messages in self.kept.values():
            messages.clear()

    def _watch(self, topic: Topic) -> None:
        kept = self.kept[topic]
        profile = QoSProfile(
            history=topic.qos.history,
            depth=RECEIVE_DEPTH,
            reliability=topic.qos.reliability,
            durability=topic.qos.durability,
        )

        def received(data: bytes, info: dict[str, Any]) -> None:
            kept.append((info["source_timestamp"], data))

        endpoints.subscription(self, topic, received, profile, raw=True)
