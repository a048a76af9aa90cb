"""Times at which a message was sent and received, by the steady clock."""

from mhsb_model.trajectory import SECOND_NS

MAX_TRANSPORT_TIME = 2.0
"""Longest accepted time from the sending of a message to its callback [s].

A longer time means that the clocks of sender and receiver differ. The middleware sends a lost
message again after a few tenths of a second.
"""


def find_message_times(
    info: dict[str, int], steady_time: float, system_ns: int
) -> tuple[float, float]:
    """Find the times at which a message was sent and received, by the steady clock.

    If the middleware gives no time of receipt, or a time in the future, the message counts as
    received now. A receipt more than `MAX_TRANSPORT_TIME` ago counts as `MAX_TRANSPORT_TIME` ago.
    In three cases the message counts as sent when it was received: the middleware gives no time of
    sending, or this time is more than `MAX_TRANSPORT_TIME` ago or later than the receipt.

    Args:
        info: rclpy's information on the message. `source_timestamp` and `received_timestamp` are
            the times of sending and receipt by the system clocks [ns]; 0 means not given.
        steady_time: Present time by the steady clock [s].
        system_ns: Present time by the system clock [ns].

    Returns:
        Time of sending and time of receipt by the steady clock [s]. The message is never sent after
        its receipt.
    """
    sent_ns, received_ns = info["source_timestamp"], info["received_timestamp"] or system_ns
    waited = min(max(0.0, (system_ns - received_ns) / SECOND_NS), MAX_TRANSPORT_TIME)
    under_way = (system_ns - sent_ns) / SECOND_NS
    if not waited <= under_way <= MAX_TRANSPORT_TIME:
        under_way = waited
    return steady_time - under_way, steady_time - waited
