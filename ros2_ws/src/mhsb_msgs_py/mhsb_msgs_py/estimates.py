"""Codec: what an arm has learnt of itself, as sensor_msgs/JointState.

As in `actuator_states`, each number is an entry whose value stands in `position`: of an estimate
`payload` or `actuator_1/friction`, its standard deviation `payload/deviation`, and `payload/known`,
0 where the motion so far has not told it. `velocity` and `effort` stay empty.
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence

from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from mhsb_model.arm_reports import Estimate
from mhsb_msgs_py import checks, stamps
from mhsb_msgs_py.errors import MessageError

DEVIATION, KNOWN = "/deviation", "/known"


def entry_name(estimate: Estimate) -> str:
    """`payload`, or `actuator_1/friction`."""
    return "/".join(filter(None, (estimate.actuator, estimate.quantity)))


def encode(estimates: Sequence[Estimate], stamp_ns: int) -> JointState:
    """Message of all that is learnt, at a time [ns]."""
    entries: dict[str, float] = {}
    for each in estimates:
        name = entry_name(each)
        entries[name] = each.value
        entries[name + DEVIATION], entries[name + KNOWN] = each.deviation, float(each.known)
    return JointState(
        header=Header(stamp=stamps.to_time(stamp_ns)),
        name=list(entries),
        position=array("d", entries.values()),
    )


def decode(message: JointState) -> list[Estimate]:
    """The estimates of a message; MessageError where names, sizes or numbers are not right."""
    names = list(message.name)
    order = checks.joint_order("estimates", names, sorted(set(names)))
    checks.empty("velocity", message.velocity)
    checks.empty("effort", message.effort)
    numbers = checks.values("position", message.position, order)
    entries = dict(zip(sorted(set(names)), numbers.tolist(), strict=True))
    found = []
    for name in names:
        if name.endswith((DEVIATION, KNOWN)):
            continue
        if not {name + DEVIATION, name + KNOWN} <= entries.keys():
            raise MessageError(
                f"estimates has {name} without {name}{DEVIATION} and {name}{KNOWN}; give all three"
            )
        deviation = entries[name + DEVIATION]
        if deviation < 0.0:
            raise MessageError(f"estimates has {name}{DEVIATION} {deviation:g}; give at least 0")
        actuator, _, quantity = name.rpartition("/")
        known = entries[name + KNOWN] != 0.0
        found.append(Estimate(quantity, actuator, entries[name], deviation, known))
    return found
