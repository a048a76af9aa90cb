"""Command `record`: write the suite's topics into a rosbag2 folder, or repair one."""

import functools
import json as json_format
import time
from pathlib import Path
from typing import Annotated, Any

import rclpy
import tyro
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile

from mhsb_model import process
from mhsb_model.command_line import NumberRange, UsageError, make_main
from mhsb_model.errors import MhsbError
from mhsb_msgs_py import topics
from mhsb_msgs_py.faults import Faults
from mhsb_msgs_py.node_process import spin_node
from mhsb_msgs_py.topics import Topic
from mhsb_tools.recording import bag_format
from mhsb_tools.recording.bag_format import BagTopic
from mhsb_tools.recording.bag_repair import Repair, repair_recording
from mhsb_tools.recording.bag_writer import BagWriter

NODE_NAME = "mhsb_recorder"
FLUSH_PERIOD = 0.25  # s
"""Period at which complete chunks are handed to the operating system [s]."""

CLOSING_TIME = 10.0
"""Time that completing a recording may take after a signal has ended the command [s]."""

RECEIVE_DEPTH = 1000
"""Received messages of a topic that may wait for the recorder; a publisher's queue is its own."""

READY_WHEN = (topics.JOINT_STATES, topics.PLAN_STATUS)
"""Topics whose publishers show that the simulator and the planner are connected."""


class Recorder(Node):
    """Node that subscribes to the suite's topics as raw bytes and writes each message on arrival.

    It prints "ready" once when publishers of all READY_WHEN topics have been matched.

    Attributes:
        faults: Handler of exceptions in callbacks; an MhsbError, such as a failed write, ends the
            node.
    """

    def __init__(self, bag: BagWriter, duration: float | None, silent: bool = False) -> None:
        """Subscribe to all topics of the suite and start recording.

        Complete chunks are handed to the operating system every FLUSH_PERIOD. The timers for
        FLUSH_PERIOD and `duration` use the steady clock, so simulated time has no influence.

        Args:
            bag: Open recording that receives the messages; the caller completes it.
            duration: Time after which ROS is shut down, which ends the node [s]; None for never.
            silent: True prints nothing, not even "ready".
        """
        super().__init__(NODE_NAME)
        self.faults = Faults(self, ending_errors=(MhsbError,))  # a failed write ends the recorder
        self._bag = bag
        self._connected: set[str] = set()
        self._ready = False
        self._silent = silent
        for topic in topics.SUITE_TOPICS:
            self._subscribe(topic)
        wall = Clock(clock_type=ClockType.STEADY_TIME)  # independent of /clock
        self.create_timer(FLUSH_PERIOD, bag.flush, clock=wall)
        if duration is not None:
            end = functools.partial(rclpy.try_shutdown, context=self.context)
            self.create_timer(duration, end, clock=wall)
        self._print_line(f"recording into {bag.folder}")

    def _subscribe(self, topic: Topic) -> None:
        """Add a topic to the recording and subscribe to it as raw bytes.

        Each message is written on arrival. If a publisher is matched, the topic counts as
        connected.

        Args:
            topic: The topic. Its QoS is used, but with a queue of RECEIVE_DEPTH messages.
        """
        name = self.resolve_topic_name(topic.name)
        profile = QoSProfile(
            history=topic.qos.history,
            depth=RECEIVE_DEPTH,
            reliability=topic.qos.reliability,
            durability=topic.qos.durability,
        )
        self._bag.add_topic(BagTopic(name, topic.type_name, bag_format.format_qos(topic.qos)))

        def received(data: bytes, info: dict[str, Any]) -> None:
            """Write a message with the times at which it was received and sent.

            Args:
                data: Serialized message.
                info: Message info of rclpy, with `received_timestamp` and `source_timestamp` [ns].
            """
            received_ns = info["received_timestamp"] or time.time_ns()  # Cyclone DDS gives none
            self._bag.write(name, data, received_ns, info["source_timestamp"])

        def matched(info: Any) -> None:
            """Note that a publisher of the topic is connected, and print "ready" if all are there.

            All are there if each topic of READY_WHEN (one of the simulator, one of the planner) has
            been connected. The line is printed once; a silent recorder does not print it.

            Args:
                info: Status of the matched event of rclpy, with `current_count` publishers.
            """
            if info.current_count > 0:
                self._connected.add(topic.name)
            if not self._ready and all(each.name in self._connected for each in READY_WHEN):
                self._ready = True
                self._print_line("ready: simulator and planner are heard")

        self.create_subscription(
            topic.message,
            topic.name,
            received,
            profile,
            raw=True,
            event_callbacks=SubscriptionEventCallbacks(
                matched=matched,
                use_default_callbacks=False,  # they cost time, see mhsb_msgs_py.endpoints
            ),
        )

    def _print_line(self, words: str) -> None:
        """Print a line unless the recorder is silent."""
        if not self._silent:
            print(words, flush=True)


def record(
    output: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None,
    duration: Annotated[float | None, tyro.conf.arg(metavar="S"), NumberRange(1e-3, 1e9)] = None,
    repair: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None,
    json: bool = False,
) -> int:
    """Record the suite's topics as a rosbag2 folder (MCAP) until interrupted.

    Args:
        output: New folder of the recording.
        duration: Stop by itself after this time [s, wall clock].
        repair: Complete this damaged recording instead of recording; the damaged files are kept
            beside it.
        json: Print one JSON object at the end instead of text.

    Returns:
        The exit code 0, after a recording and after a repair.

    Raises:
        UsageError: Not exactly one of `output` and `repair` is given, or `duration` is given
            with `repair`.
        BagError: The recording cannot be written or repaired.
        RosArgumentsError: The arguments after `--ros-args` cannot be used.
        RosError: ROS cannot make the node in this environment.
    """
    if repair is not None and output is None:
        if duration is not None:
            raise UsageError(
                f"--duration {duration:g} has no effect: with --repair nothing is recorded; "
                "leave it out"
            )
        _print_repair(repair_recording(repair), repair, as_json=json)
        return 0
    if output is None or repair is not None:
        raise UsageError("give either --output DIR or --repair DIR; see mhsb record --help")
    with process.grace_period(CLOSING_TIME), BagWriter(output) as bag:
        code = spin_node(lambda: Recorder(bag, duration, json))
    if json:
        print(json_format.dumps({"folder": str(output), "messages": bag.message_count}))
    else:
        print(f"recorded {bag.message_count} messages in {output}")
    return code


def _print_repair(done: Repair, folder: Path, *, as_json: bool) -> None:
    """Print the result of a repair as a sentence, or as one JSON object.

    Args:
        done: Result of the repair.
        folder: Folder of the recording.
        as_json: Whether the JSON object is printed.
    """
    if not as_json:
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


main = make_main(record, node=True)
