"""Times of messages: what the middleware states, and what cannot be true."""

import pytest

from mhsb_planner.ros.message_times import find_message_times

NOW_NS = 1_700_000_000_000_000_000
NOW = 50.0


def ago(seconds):
    return NOW_NS - round(1e9 * seconds)


@pytest.mark.parametrize(
    ("sent_ns", "received_ns", "sent", "received"),
    [
        (ago(0.165), ago(0.001), 0.165, 0.001),  # it was lost and sent again
        (ago(0.165), 0, 0.165, 0.0),  # Cyclone DDS gives no time of receipt
        (0, ago(0.03), 0.03, 0.03),  # no time of sending
        (0, 0, 0.0, 0.0),
        (ago(3600.0), ago(0.03), 0.03, 0.03),  # the sender's clock is slow
        (ago(-5.0), ago(0.03), 0.03, 0.03),  # it is fast
        (ago(0.02), ago(0.03), 0.03, 0.03),
        (ago(0.2), ago(-1.0), 0.2, 0.0),  # the receiver's clock was set back
        (ago(7.0), ago(6.0), 2.0, 2.0),  # the receiver was busy for long
    ],
)
def test_a_message_was_sent_and_received_when_its_stamps_say_so_where_they_can_be_true(
    sent_ns, received_ns, sent, received
):
    info = {"source_timestamp": sent_ns, "received_timestamp": received_ns}
    assert find_message_times(info, NOW, NOW_NS) == pytest.approx((NOW - sent, NOW - received))
