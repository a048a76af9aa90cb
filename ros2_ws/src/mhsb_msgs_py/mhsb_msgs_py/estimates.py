"""Codec of the values that an arm has estimated of itself, as sensor_msgs/JointState.

Each number is an entry whose value is in `position`. An estimate has three entries, for instance
`payload`, `payload/deviation` (its standard deviation) and `payload/known`. The last one is 0 if
the motion so far has not determined the estimate. `velocity` and `effort` stay empty.
"""

from array import array
from collections.abc import Sequence

from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from mhsb_model.arm_reports import Estimate
from mhsb_msgs_py import checks, stamps
from mhsb_msgs_py.errors import MessageError

DEVIATION_SUFFIX, KNOWN_SUFFIX = "/deviation", "/known"
"""Endings of the names of an estimate's two further entries."""


def entry_name(estimate: Estimate) -> str:
    """Return the name of an estimate's entry, such as `payload` or `actuator_1/friction`."""
    return "/".join(filter(None, (estimate.actuator, estimate.quantity)))


def encode(estimates: Sequence[Estimate], stamp_ns: int) -> JointState:
    """Encode estimates, each as three entries: value, standard deviation and `known` (0 or 1).

    Args:
        estimates: The estimates.
        stamp_ns: Stamp of the message [ns].

    Returns:
        The message; the entries' values are in `position`.
    """
    entries: dict[str, float] = {}
    for each in estimates:
        name = entry_name(each)
        entries[name] = each.value
        entries[name + DEVIATION_SUFFIX], entries[name + KNOWN_SUFFIX] = (
            each.deviation,
            float(each.known),
        )
    return JointState(
        header=Header(stamp=stamps.to_time(stamp_ns)),
        name=list(entries),
        position=array("d", entries.values()),
    )


def decode(message: JointState) -> list[Estimate]:
    """Decode a message to estimates.

    The value of an estimate is in the entry NAME, its standard deviation in NAME/deviation.
    NAME/known is 0 if the motion so far has not determined the value, otherwise 1.

    Args:
        message: The message, with its entries in any order.

    Returns:
        One estimate for each value, in the order of the values in the message. Entries
        NAME/deviation and NAME/known without an entry NAME are ignored.

    Raises:
        MessageError: One of these holds. A name is given twice. A name has no value, or a value
            that is not finite. A value NAME lacks its entry NAME/deviation or NAME/known. A
            deviation is negative. `velocity` or `effort` is not empty.
    """
    names = list(message.name)
    order = checks.find_joint_order("estimates", names, sorted(set(names)))
    checks.check_empty("velocity", message.velocity)
    checks.check_empty("effort", message.effort)
    numbers = checks.check_values("position", message.position, order)
    entries = dict(zip(sorted(set(names)), numbers.tolist(), strict=True))
    found = []
    for name in names:
        if name.endswith((DEVIATION_SUFFIX, KNOWN_SUFFIX)):
            continue
        if not {name + DEVIATION_SUFFIX, name + KNOWN_SUFFIX} <= entries.keys():
            raise MessageError(
                f"estimates has {name} without {name}{DEVIATION_SUFFIX} and {name}{KNOWN_SUFFIX}; "
                "give all three"
            )
        deviation = entries[name + DEVIATION_SUFFIX]
        if deviation < 0.0:
            raise MessageError(
                f"estimates has {name}{DEVIATION_SUFFIX} {deviation:g}; give at least 0"
            )
        actuator, _, quantity = name.rpartition("/")
        known = entries[name + KNOWN_SUFFIX] != 0.0
        found.append(Estimate(quantity, actuator, entries[name], deviation, known))
    return found
