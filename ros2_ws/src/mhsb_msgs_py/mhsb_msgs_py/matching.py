"""Subscriptions that also receive from publishers whose quality of service does not match theirs.

A reliable subscription gets nothing from a best-effort publisher, such as a micro controller. A
transient-local subscription gets nothing from a volatile publisher. ROS then delivers nothing and
only logs an event. `MatchingSubscriptions` opens a second subscription with the publisher's own
quality of service. The first one remains for all other publishers.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from mhsb_msgs_py.topics import Topic

MESSAGE_CAPACITY = 64
"""Number of last messages of a topic among which duplicates are recognized."""

Offer = tuple[ReliabilityPolicy, DurabilityPolicy]
"""Reliability and durability that a publisher offers."""


@dataclass(eq=False)
class _SubscribedTopic:
    """Topic with its subscriptions.

    Attributes:
        topic: Name, type and requested quality of service.
        callback: Function that is called once for each message, with the message and rclpy's
            information on it.
        first: The subscription with the topic's own quality of service; None before it is made.
        further: Further subscriptions, each for publishers that the first one does not match. Keys
            are the reliability and durability of these publishers.
        keys: Publishing time [ns] and sequence number of the last messages.
    """

    topic: Topic
    callback: Callable[[Any, dict[str, int]], None]
    first: Subscription | None = None
    further: dict[Offer, Subscription] = field(default_factory=dict)
    keys: deque[tuple[int, int]] = field(default_factory=lambda: deque(maxlen=MESSAGE_CAPACITY))

    def pass_on(self, message: Any, info: dict[str, int]) -> None:
        """Pass a message to the callback if no other subscription has received it before.

        If the topic has further subscriptions, a message can come twice. Such duplicates are
        recognized by publishing time and sequence number among the last MESSAGE_CAPACITY messages.
        Without further subscriptions, all messages are passed on.

        Args:
            message: The message.
            info: rclpy's information on the message.
        """
        if self.further:
            key = info["source_timestamp"], info.get("publication_sequence_number") or 0
            if key in self.keys:
                return
            self.keys.append(key)
        self.callback(message, info)


class MatchingSubscriptions:
    """Subscriptions of a node; `update` opens further ones if publishers need them.

    Attributes:
        problem: One sentence that names all publishers with which a topic's own subscription does
            not match; empty if there is none.
    """

    def __init__(self, node: Node) -> None:
        """Store the node; `add` makes the subscriptions.

        Args:
            node: Node that gets the subscriptions.
        """
        self._node = node
        self._topics: list[_SubscribedTopic] = []
        self.problem = ""

    def add(
        self,
        topic: Topic,
        callback: Callable[[Any, dict[str, int]], None],
        *,
        at_once: bool = False,
    ) -> Subscription:
        """Subscribe to a topic with its own quality of service.

        Args:
            topic: Name, type and quality of service.
            callback: Called with each message and rclpy's information on it.
            at_once: When to open a further subscription for a publisher that does not match: True
                as soon as ROS finds it, False at the next call of `update`. True costs time, since
                the executor then checks for this event at every wake.

        Returns:
            The subscription with the topic's own quality of service.
        """
        subscribed = _SubscribedTopic(topic, callback)
        found = (lambda event: self.update()) if at_once else None
        events = SubscriptionEventCallbacks(incompatible_qos=found, use_default_callbacks=False)
        subscribed.first = self._subscribe(subscribed, topic.qos, events)
        self._topics.append(subscribed)
        return subscribed.first

    def update(self) -> None:
        """Open further subscriptions for publishers that a topic's own subscription does not match.

        There is one further subscription for each combination of reliability and durability that
        such publishers offer. It is logged when it is opened, and closed again when all its
        publishers are gone. `problem` is updated. It names all publishers that do not match the
        topic's own subscription, even if a further subscription serves them.
        """
        problems = []
        for subscribed in self._topics:
            offers: dict[Offer, list[str]] = {}
            for each in self._node.get_publishers_info_by_topic(subscribed.topic.name):
                offer = each.qos_profile.reliability, each.qos_profile.durability
                if _describe_mismatch(subscribed.topic.qos, offer):
                    name = f"{each.node_namespace.rstrip('/')}/{each.node_name}"
                    offers.setdefault(offer, []).append(name)
            for offer in subscribed.further.keys() - offers.keys():
                self._node.destroy_subscription(subscribed.further.pop(offer))
            for offer, names in offers.items():
                publishers = f"{subscribed.topic.name} of {', '.join(names)}"
                problems.append(
                    f"{publishers} is {_describe_mismatch(subscribed.topic.qos, offer)}"
                )
                if offer not in subscribed.further:
                    self._open(subscribed, offer, problems[-1])
        self.problem = "; ".join(problems)

    def _open(self, subscribed: _SubscribedTopic, offer: Offer, problem: str) -> None:
        """Subscribe to a topic once more, with the quality of service of a publisher, and log this.

        Args:
            subscribed: The topic. The subscription is added to its `further` in place.
            offer: Reliability and durability of the publisher.
            problem: Sentence that describes the mismatch, for the log.
        """
        reliability, durability = offer
        qos = QoSProfile(
            history=subscribed.topic.qos.history,
            depth=subscribed.topic.qos.depth,
            reliability=reliability,
            durability=durability,
        )
        silent = SubscriptionEventCallbacks(use_default_callbacks=False)
        subscribed.further[offer] = self._subscribe(subscribed, qos, silent)
        self._node.get_logger().warning(
            f"{problem}; it is heard as it comes: messages may be lost, and what was said before "
            "now is not known"
        )

    def _subscribe(
        self, subscribed: _SubscribedTopic, qos: QoSProfile, events: SubscriptionEventCallbacks
    ) -> Subscription:
        """Create a subscription whose messages go to `subscribed.pass_on`.

        Args:
            subscribed: The topic.
            qos: Quality of service of the subscription.
            events: Callbacks for events of the subscription.
        """
        topic = subscribed.topic
        return self._node.create_subscription(
            topic.message, topic.name, subscribed.pass_on, qos, event_callbacks=events
        )


def _describe_mismatch(wanted: QoSProfile, offer: Offer) -> str:
    """Describe why a subscription receives nothing from a publisher, by the rules of DDS.

    Args:
        wanted: Quality of service of the subscription.
        offer: Reliability and durability of the publisher.

    Returns:
        "best effort, not reliable", "volatile, not transient local", or both joined by "and". Empty
        if the subscription receives from the publisher.
    """
    less = []
    reliabilities, durabilities = zip((wanted.reliability, wanted.durability), offer, strict=True)
    if reliabilities == (ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT):
        less.append("best effort, not reliable")
    if durabilities == (DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.VOLATILE):
        less.append("volatile, not transient local")
    return " and ".join(less)
