"""Publishers and subscriptions of the suite's own topics, and a check for duplicates of them.

By default rclpy gives every publisher and subscription two events. They only log that the other end
of the topic has another QoS or type. The executor checks every event whenever it wakes. At hundreds
of messages a second these checks took a third of the planner's processor time at rest. So the
suite's own publishers and subscriptions have no events; the other end logs a mismatch.
Subscriptions to topics on which people publish by hand keep the events.
"""

from collections.abc import Callable, Sequence
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from mhsb_msgs_py.topics import Topic

LEASE_TIME = 20.0
"""Time after which the ROS graph forgets a killed process [s], the lease of Fast DDS."""


def make_publisher(node: Node, topic: Topic) -> Publisher:
    """Create a publisher on a topic of the suite, without rclpy's default event callbacks.

    Args:
        node: Node that publishes.
        topic: Name, type and quality of service.
    """
    silent = PublisherEventCallbacks(use_default_callbacks=False)
    return node.create_publisher(topic.message, topic.name, topic.qos, event_callbacks=silent)


def make_subscription(
    node: Node,
    topic: Topic,
    callback: Callable[..., Any],
    qos: QoSProfile | None = None,
    raw: bool = False,
) -> Subscription:
    """Subscribe to a topic of the suite's own nodes, without rclpy's default event callbacks.

    Args:
        node: Node that subscribes.
        topic: Name, type and quality of service.
        callback: Called with each message.
        qos: Quality of service; None takes the topic's own.
        raw: True if the callback gets the serialized bytes instead of a message.
    """
    silent = SubscriptionEventCallbacks(use_default_callbacks=False)
    return node.create_subscription(
        topic.message, topic.name, callback, qos or topic.qos, raw=raw, event_callbacks=silent
    )


def describe_duplicates(node: Node, publishers: Sequence[Publisher]) -> str:
    """Report if a node's name or its topics are used more than once in the ROS graph.

    The function counts the nodes with this node's full name, and the publishers on the topic of
    each given publisher. One call takes a fraction of a millisecond; one call a second is enough.

    Args:
        node: The node.
        publishers: Publishers of the node on topics where no other node should publish.

    Returns:
        One sentence with the numbers of nodes and publishers; empty if there is no duplicate.
    """
    problems = []
    own = node.get_fully_qualified_name()
    names = [
        f"{namespace.rstrip('/')}/{name}"
        for name, namespace in node.get_node_names_and_namespaces()
    ]
    if names.count(own) > 1:
        problems.append(f"there are {names.count(own)} nodes called {own}")
    for publisher in publishers:
        count = node.count_publishers(publisher.topic_name)
        if count > 1:
            problems.append(f"{publisher.topic_name} has {count} publishers")
    if not problems:
        return ""
    return (
        f"{', '.join(problems)}; one is allowed: end the others (what was killed counts for "
        f"{LEASE_TIME:g} s)"
    )
