"""Quality of service of the suite's topics and services."""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy


def _profile(
    depth: int,
    reliability: ReliabilityPolicy = ReliabilityPolicy.RELIABLE,
    durability: DurabilityPolicy = DurabilityPolicy.VOLATILE,
) -> QoSProfile:
    """Return a profile that keeps the last `depth` messages."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST, depth=depth, reliability=reliability, durability=durability
    )


DEFAULT = _profile(10)
"""Profile of streams and commands."""

STATUS = _profile(100)
"""Profile of goals, verdicts and execution reports: each goal that came gets its verdict."""

LATCHED = _profile(1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Profile of state that a late subscriber must get: the last message is kept for it."""

SERVICE_DEPTH = 4000
"""Number of requests and answers that a service of the suite keeps until they are taken.

ROS's default of 10 loses requests that come at once. A client's queue holds the answers to all
clients.
"""

SERVICE = _profile(SERVICE_DEPTH)
"""Profile of the suite's services, of its action's services, and of their clients."""

CLOCK = _profile(1, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Profile with which all of ROS subscribes /clock."""
