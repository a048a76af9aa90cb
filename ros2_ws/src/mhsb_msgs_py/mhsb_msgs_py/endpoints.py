"""Publishers and subscriptions of the suite's own topics, lean on the executor.

rclpy gives every publisher and subscription two events by default, which only log that somebody at
the other end has another QoS or type. The executor looks at each of them whenever it wakes: at
hundreds of messages a second that took a third of the planner's processor time at rest. Whoever is
at the other end is told there. Subscriptions that people publish on by hand keep the events.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from mhsb_msgs_py.topics import Topic


def publisher(node: Node, topic: Topic) -> Publisher:
    """A publisher on a topic of the suite."""
    silent = PublisherEventCallbacks(use_default_callbacks=False)
    return node.create_publisher(topic.message, topic.name, topic.qos, event_callbacks=silent)


def subscription(
    node: Node,
    topic: Topic,
    callback: Callable[..., Any],
    qos: QoSProfile | None = None,
    raw: bool = False,
) -> Subscription:
    """A subscription of a topic that the suite's own nodes publish.

    qos: in place of the topic's own.
    """
    silent = SubscriptionEventCallbacks(use_default_callbacks=False)
    return node.create_subscription(
        topic.message, topic.name, callback, qos or topic.qos, raw=raw, event_callbacks=silent
    )
