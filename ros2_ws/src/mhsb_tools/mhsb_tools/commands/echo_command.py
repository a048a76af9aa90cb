"""`echo`: print the messages of a topic as YAML, as `ros2 topic echo` does."""

import importlib
import json as json_format
from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
import tyro
import yaml
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.validate_topic_name import validate_topic_name

from mhsb_model import command_line
from mhsb_model.command_line import NumberRange
from mhsb_model.errors import MhsbError
from mhsb_msgs_py.node_process import run_command_node, spin_until
from mhsb_planner.result_files import replace_non_finite

QUEUE_DEPTH = 100
"""Messages that wait to be printed; older ones are dropped."""

LONG_TIME = 1e9
"""Time to wait without a limit [s]."""


class TopicError(MhsbError):
    """A topic cannot be printed."""


def echo(
    topic: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="TOPIC")],
    once: bool = False,
    timeout: Annotated[float, tyro.conf.arg(metavar="S"), NumberRange(0.0, 1e6)] = 10.0,
    json: bool = False,
) -> None:
    """Print the messages of a topic as YAML until interrupted; `---` ends each.

    Type and QoS are those of the topic's publishers, so an earlier message of a latched topic is
    printed as well. Numbers are as in the message, in SI units.

    Args:
        topic: Name of the topic, such as plan_status.
        once: Print one message and end.
        timeout: How long to wait for a publisher [s]; with --once, the limit of the wait for a
            message, too.
        json: Print each message as a JSON object on one line; NaN and infinite numbers are null.

    Raises:
        TopicError: There is no publisher in time, or with `once` no message in time. Or the
            message type is not installed.
        RosNameError: ROS does not take the name of the topic.
        RosError: ROS cannot make a node in this environment.
    """
    try:
        with run_command_node(lambda: Node("mhsb_echo")) as (executor, node):
            _print_messages(node, executor, topic, once, timeout, json)
    except KeyboardInterrupt:
        pass  # the usual end


def _print_messages(
    node: Node,
    executor: SingleThreadedExecutor,
    topic: str,
    once: bool,
    timeout: float,
    as_json: bool,
) -> None:
    """Subscribe to a topic and print its messages.

    With `once`, the function returns after one message. Otherwise it runs until the process is
    interrupted.

    Args:
        node: Node of this process.
        executor: Executor that serves `node`.
        topic: Name of the topic, absolute or relative to the node's namespace.
        once: Whether to return after one message.
        timeout: Longest wait for a publisher [s]; with `once`, also the longest wait for the
            message.
        as_json: Whether to print each message as one line of JSON instead of YAML.

    Raises:
        NameValidationException: ROS does not take the name.
        TopicError: There is no publisher in time, `once` is set and no message came in time, or the
            message type is not installed.
    """
    printed = 0

    def print_message(message: Any) -> None:
        """Print one message, or ignore it if `once` is set and one was printed before."""
        nonlocal printed
        if once and printed:
            return
        printed += 1
        content = to_plain(message)
        if as_json:
            print(format_json(content), flush=True)
        else:
            print(yaml.safe_dump(content, sort_keys=False, allow_unicode=True) + "---", flush=True)

    validate_topic_name(topic)
    name = node.resolve_topic_name(topic)
    if not spin_until(executor, lambda: node.count_publishers(name) > 0, timeout):
        known = [each for each, _ in node.get_topic_names_and_types()]
        raise TopicError(
            f"nobody publishes {name} within {timeout:g} s; there are {', '.join(sorted(known))}"
        )
    type_name, profile = _describe_publishers(node, name)
    node.create_subscription(_find_message_class(type_name), name, print_message, profile)
    longest = timeout if once else LONG_TIME
    if not spin_until(executor, lambda: once and printed > 0, longest):
        raise TopicError(f"no message of {name} within {timeout:g} s")


def _describe_publishers(node: Node, name: str) -> tuple[str, QoSProfile]:
    """Return the message type of a topic and the QoS to subscribe with.

    Reliability is reliable if all publishers are reliable, else best effort. Durability is
    transient local if all publishers are transient local, else volatile.

    Args:
        node: Node of this process.
        name: Full name of a topic with publishers.

    Returns:
        Type of the first publisher, such as `std_msgs/msg/String`, and the QoS profile for a
        subscription that matches all publishers.
    """
    publishers = node.get_publishers_info_by_topic(name)
    profile = QoSProfile(depth=QUEUE_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
    offered = [each.qos_profile for each in publishers]
    if all(each.reliability is ReliabilityPolicy.RELIABLE for each in offered):
        profile.reliability = ReliabilityPolicy.RELIABLE
    if all(each.durability is DurabilityPolicy.TRANSIENT_LOCAL for each in offered):
        profile.durability = DurabilityPolicy.TRANSIENT_LOCAL
    return publishers[0].topic_type, profile


def _find_message_class(type_name: str) -> Any:
    """Return the Python class of a message type.

    Args:
        type_name: The type, such as `std_msgs/msg/String`.

    Returns:
        The class.

    Raises:
        TopicError: The package of the type is not installed or does not have the type.
    """
    package, _, name = type_name.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name)
    except (ModuleNotFoundError, AttributeError):
        raise TopicError(f"messages of type {type_name} are not installed here") from None


def format_json(content: Any) -> str:
    """Format plain content as JSON, which has no NaN and no infinite numbers.

    Args:
        content: Nested dicts and lists, as `to_plain` returns them.

    Returns:
        The text on one line. Numbers that are not finite are null.
    """
    return json_format.dumps(replace_non_finite(content), allow_nan=False)


def to_plain(value: Any) -> Any:
    """Convert a ROS message, or the value of one of its fields, to plain Python types.

    Args:
        value: Message or value.

    Returns:
        A type that YAML and JSON can hold. Messages become dictionaries in the order of their
        fields, arrays become lists, NumPy scalars become Python numbers. `bytes` of length 1 (an
        octet) become an integer, longer ones a list of integers. Other values are returned as they
        are.
    """
    if hasattr(value, "get_fields_and_field_types"):
        names = value.get_fields_and_field_types()
        return {name: to_plain(getattr(value, name)) for name in names}
    if isinstance(value, bytes):
        return value[0] if len(value) == 1 else list(value)
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [to_plain(each) for each in value]
    return value


main = command_line.make_main(echo, node=True)
