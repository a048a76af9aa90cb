"""Times and durations of ROS as integer nanoseconds, in which nothing is lost."""

from __future__ import annotations

from builtin_interfaces.msg import Duration, Time

from mhsb_model.trajectory import SECOND_NS
from mhsb_msgs_py.errors import MessageError

MOST_DIGITS = 10
"""Digits of the seconds of a time as text; a message has 2^31 s at most."""

FIRST_SECOND, LAST_SECOND = -(2**31), 2**31 - 1


def to_time(time_ns: int) -> Time:
    """Time message of an absolute time [ns]; ValueError beyond what its seconds can hold."""
    return Time(**_fields(time_ns))


def from_time(message: Time) -> int:
    """Absolute time [ns]."""
    return _nanoseconds(message)


def to_duration(duration_ns: int) -> Duration:
    """Duration message of a duration [ns]; ValueError beyond what its seconds can hold."""
    return Duration(**_fields(duration_ns))


def from_duration(message: Duration) -> int:
    """Duration [ns]."""
    return _nanoseconds(message)


def to_text(time_ns: int) -> str:
    """A time [ns] as seconds with nine decimals, exactly: `12.000000005`."""
    sign = "-" if time_ns < 0 else ""
    seconds, nanoseconds = divmod(abs(time_ns), SECOND_NS)
    return f"{sign}{seconds}.{nanoseconds:09d}"


def from_text(text: str) -> int:
    """The time [ns] that `to_text` wrote."""
    seconds, dot, decimals = text.removeprefix("-").partition(".")
    readable = dot and seconds.isdecimal() and decimals.isdecimal() and len(decimals) == 9
    if not readable or len(seconds) > MOST_DIGITS:
        raise MessageError(
            f"the time '{text[:40]}' cannot be read; give seconds with nine decimals, as "
            "12.000000005"
        )
    time_ns = int(seconds) * SECOND_NS + int(decimals)
    return -time_ns if text.startswith("-") else time_ns


def check_nanoseconds(nanosec: int) -> None:
    """MessageError where a time or duration has a second or more beside its seconds."""
    if nanosec >= SECOND_NS:
        raise MessageError(
            f"a time has {nanosec} ns beside its seconds; it must be below {SECOND_NS}"
        )


def _fields(time_ns: int) -> dict[str, int]:
    seconds, nanoseconds = divmod(int(time_ns), SECOND_NS)
    if not FIRST_SECOND <= seconds <= LAST_SECOND:
        raise ValueError(f"{seconds} s does not fit into a message, which holds 32 bits of seconds")
    return {"sec": seconds, "nanosec": nanoseconds}


def _nanoseconds(message: Time | Duration) -> int:
    check_nanoseconds(message.nanosec)
    return int(message.sec) * SECOND_NS + int(message.nanosec)
