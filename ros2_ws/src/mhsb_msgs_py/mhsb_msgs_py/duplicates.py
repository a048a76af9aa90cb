"""Whether a node is alone with its name and its topics, as the ROS graph has it."""

from __future__ import annotations

from collections.abc import Sequence

from rclpy.node import Node
from rclpy.publisher import Publisher

FORGOTTEN = 20.0
"""Time after which the graph forgets a process that was killed [s]: Fast DDS's lease."""


def duplicate_problem(node: Node, publishers: Sequence[Publisher]) -> str:
    """What of this node is there twice, in one sentence; empty where nothing is.

    publishers: own ones, on topics where nobody else should publish. One look costs a fraction of
    a millisecond; once a second is often enough.
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
        f"{FORGOTTEN:g} s)"
    )
