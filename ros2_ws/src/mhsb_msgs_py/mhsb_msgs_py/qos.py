"""Quality of service of the suite's topics, by name."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy


def _profile(
    depth: int,
    reliability: ReliabilityPolicy = ReliabilityPolicy.RELIABLE,
    durability: DurabilityPolicy = DurabilityPolicy.VOLATILE,
) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST, depth=depth, reliability=reliability, durability=durability
    )


DEFAULT = _profile(10)
"""Streams and commands."""

STATUS = _profile(100)
"""Verdicts: none may be lost in a flood of goals."""

LATCHED = _profile(1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""State that a late joiner must see: the last message is kept for him."""

CLOCK = _profile(1, reliability=ReliabilityPolicy.BEST_EFFORT)
"""What all of ROS listens to /clock with."""
