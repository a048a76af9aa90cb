"""Command `record`: the suite's topics into a rosbag2 folder."""

from __future__ import annotations

import json as json_format
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import rclpy
import tyro
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile

from mhsb_model import process
from mhsb_model.command_line import UsageError, Within, run
from mhsb_msgs_py import topics
from mhsb_msgs_py.node_process import spin_node
from mhsb_msgs_py.topics import Topic
from mhsb_sim.recording import bag_format
from mhsb_sim.recording.bag_format import BagTopic
from mhsb_sim.recording.bag_repair import Repair, repair
from mhsb_sim.recording.bag_writer import BagWriter

NODE_NAME = "mhsb_recorder"
FLUSH_PERIOD = 0.25  # s
CLOSING = 10.0
"""Time that completing a recording may take when a signal has ended it [s]."""

RECEIVE_DEPTH = 1000
"""Messages that may wait for the recorder; how many a publisher keeps is his own affair."""

READY_WHEN = (topics.JOINT_STATES, topics.PLAN_STATUS)
"""With publishers of these, both nodes of the suite are heard."""


class Recorder(Node):
    """Subscribes to the suite's topics as raw bytes and writes them as they come."""

    def __init__(self, bag: BagWriter, duration: float | None, silent: bool = False) -> None:
        super().__init__(NODE_NAME)
        self._bag = bag
        self._heard: set[str] = set()
        self._ready = False
        self._silent = silent
        for topic in topics.SUITE_TOPICS:
            self._subscribe(topic)
        wall = Clock(clock_type=ClockType.STEADY_TIME)  # whatever /clock does
        self.create_timer(FLUSH_PERIOD, bag.flush, clock=wall)
        if duration is not None:
            self.create_timer(duration, self._end, clock=wall)
        self._say(f"recording into {bag.folder}")

    def _subscribe(self, topic: Topic) -> None:
        name = self.resolve_topic_name(topic.name)
        profile = QoSProfile(
            history=topic.qos.history,
            depth=RECEIVE_DEPTH,
            reliability=topic.qos.reliability,
            durability=topic.qos.durability,
        )
        self._bag.add_topic(BagTopic(name, topic.type_name, bag_format.qos_text(topic.qos)))

        def received(data: bytes, info: dict[str, Any]) -> None:
            self._bag.write(name, data, info["received_timestamp"], info["source_timestamp"])

        def matched(info: Any) -> None:
            if info.current_count > 0:
                self._hear(topic)

        self.create_subscription(
            topic.message,
            topic.name,
            received,
            profile,
            raw=True,
            event_callbacks=SubscriptionEventCallbacks(
                matched=matched, use_default_callbacks=False  # lean, see mhsb_msgs_py.endpoints
            ),
        )

    def _hear(self, topic: Topic) -> None:
        self._heard.add(topic.name)
        if not self._ready and all(each.name in self._heard for each in READY_WHEN):
            self._ready = True
            self._say("ready: simulator and planner are heard")

    def _say(self, words: str) -> None:
        if not self._silent:
            print(words, flush=True)

    def _end(self) -> None:
        rclpy.try_shutdown(context=self.context)


@dataclass
class Record:
    """Record the suite's topics as a rosbag2 folder (MCAP) until interrupted."""

    output: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """new folder of the recording"""
    duration: Annotated[float | None, tyro.conf.arg(metavar="S"), Within(-1e9, 1e9)] = None
    """stop by itself after this time [s, wall clock]"""
    repair: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """instead of recording, complete a damaged recording; the damaged files are kept beside"""

    json: bool = False
    """print one JSON object at the end instead of text"""

    def run(self) -> int:
        """Record or repair; returns the exit code."""
        if (self.output is None) == (self.repair is None):
            raise UsageError("give either --output DIR or --repair DIR; see record --help")
        if self.duration is not None and self.duration <= 0:
            raise UsageError(f"--duration is {self.duration:g} s; it must be above 0")
        if self.duration is not None and self.repair is not None:
            raise UsageError(
                f"--duration {self.duration:g} has no effect: with --repair nothing is recorded; "
                "leave it out"
            )
        if self.repair is not None:
            self._print_repair(repair(self.repair), self.repair)
            return 0
        assert self.output is not None
        with process.orderly(CLOSING), BagWriter(self.output) as bag:
            code = spin_node(lambda: Recorder(bag, self.duration, self.json))
        if self.json:
            content = {"folder": str(self.output), "messages": bag.message_count}
            print(json_format.dumps(content))
        else:
            print(f"recorded {bag.message_count} messages in {self.output}")
        return code

    def _print_repair(self, done: Repair, folder: Path) -> None:
        """Print what a repair has kept and lost."""
        if not self.json:
            print(done.sentence(folder))
            return
        content = {
            "folder": str(folder),
            "messages": done.kept,
            "complete": done.is_complete,
            "lost_messages": done.lost,
            "lost_bytes": done.lost_bytes,
            "lost_is_exact": done.is_exact,
            "repeated": done.repeated,
            "unlisted": done.unlisted,
            "nameless": done.nameless,
            "originals": done.originals,
        }
        print(json_format.dumps(content))


def main() -> int:
    """Entry point."""
    return run(Record, node=True)


if __name__ == "__main__":
    sys.exit(main())
