"""Times and durations of ROS as integer nanoseconds, without loss."""

from builtin_interfaces.msg import Duration, Time

from mhsb_model.trajectory import SECOND_NS
from mhsb_msgs_py.errors import MessageError

MOST_DIGITS = 10
"""Largest number of digits of the seconds in a text; a message holds at most 2^31 s."""

FIRST_SECOND, LAST_SECOND = -(2**31), 2**31 - 1
"""Range of the seconds in a message [s]."""

LATEST_PRESENT = LAST_SECOND - 10_000_000
"""Latest time that a clock may show [s].

Stamps of plans up to four months later still fit into a message.
"""


def to_time(time_ns: int) -> Time:
    """Return the message of an absolute time.

    Args:
        time_ns: Time [ns].

    Returns:
        The message; its nanoseconds are not negative.

    Raises:
        ValueError: The seconds do not fit into 32 bits.
    """
    seconds, nanoseconds = divmod(int(time_ns), SECOND_NS)
    if not FIRST_SECOND <= seconds <= LAST_SECOND:
        raise ValueError(f"{seconds} s does not fit into a message, which holds 32 bits of seconds")
    return Time(sec=seconds, nanosec=nanoseconds)


def from_time(message: Time | Duration) -> int:
    """Return the time or duration of a message [ns].

    Raises:
        MessageError: The nanoseconds are 10⁹ or more.
    """
    check_nanoseconds(message.nanosec)
    return int(message.sec) * SECOND_NS + int(message.nanosec)


def from_clock(message: Time) -> int:
    """Return the time that a clock shows, if it is plausible.

    Args:
        message: Time message.

    Returns:
        Absolute time [ns].

    Raises:
        MessageError: The time is before 1970 or later than `LATEST_PRESENT`. Or its nanoseconds are
            10⁹ or more. Up to `LATEST_PRESENT`, stamps of future plans still fit into a message.
    """
    if not 0 <= message.sec <= LATEST_PRESENT:
        raise MessageError(
            f"a clock shows {message.sec} s; it must be from 0 to {LATEST_PRESENT} s, so that "
            "later times fit into a message"
        )
    return from_time(message)


def to_text(time_ns: int) -> str:
    """Return a time as seconds with nine decimals, without loss.

    Args:
        time_ns: Time [ns].

    Returns:
        A text such as "12.000000005".
    """
    sign = "-" if time_ns < 0 else ""
    seconds, nanoseconds = divmod(abs(time_ns), SECOND_NS)
    return f"{sign}{seconds}.{nanoseconds:09d}"


def from_text(text: str) -> int:
    """Return the time that a text of `to_text` stands for.

    Args:
        text: Seconds with nine decimals, such as "12.000000005"; negative times begin with a minus.

    Returns:
        Time [ns].

    Raises:
        MessageError: The text has another form, or more than MOST_DIGITS digits before the point.
    """
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
    """Raise MessageError if the nanoseconds of a time or duration are 10⁹ or more."""
    if nanosec >= SECOND_NS:
        raise MessageError(
            f"a time has {nanosec} ns beside its seconds; it must be below {SECOND_NS}"
        )
