"""Check whether a node is the only one with its name and on its topics, by the ROS graph."""

from __future__ import annotations

from collections.abc import Sequence

from rclpy.node import Node
from rclpy.publisher import Publisher

LEASE_TIME = 20.0
"""Time after which the ROS graph forgets a killed process [s], the lease of Fast DDS."""


def describe_duplicates(node: Node, publishers: Sequence[Publisher]) -> str:
    """Describe which names and topics of a node are used more than once in the ROS graph.

    It counts nodes with the node's full name, and publishers on each of the given topics. One call
    takes a fraction of a millisecond; once a second is often enough.

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
