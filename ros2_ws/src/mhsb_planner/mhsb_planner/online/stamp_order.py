"""Check of the order of stamps, which shows a clock that was set back, or several publishers."""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import Enum

DECIDED_AFTER = 1.0
"""Time after which a second step back of stamps no longer means several publishers [s].

Two publishers send references at least twice a second, so their stamps go back again sooner. A
clock is not set back twice within this time.
"""

SECOND_PUBLISHER_TIMEOUT = 3.0
"""Time without a further step back of stamps after which a second publisher counts as gone [s]."""


class Order(Enum):
    """Conclusion from the stamp of a message about the clocks of the publishers of its topic."""

    FORWARD = "later than all before"
    BACK = "the clock was set back"
    MIXED = "of a clock behind another one, or not decided yet"


class StampOrder:
    """Detector of the cause of earlier stamps: a clock set back, or publishers with other clocks.

    The stamps of one publisher go back once when its clock is set back. With two publishers they go
    back again and again. The ROS graph shows a killed process for a while, so the number of
    publishers in it is not sufficient.

    Attributes:
        publisher_conflict: Sentence that names several publishers whose clocks differ; empty
            without them.
    """

    def __init__(self, several_publishers: Callable[[], str]) -> None:
        """Begin without a stamp.

        Args:
            several_publishers: Function that returns a sentence that names the publishers in the
                ROS graph if there are several, otherwise an empty text. It is called at each step
                back of the stamps.
        """
        self.publisher_conflict = ""
        self._several_publishers = several_publishers
        self._last_ns = -1
        self._latest_ns = -1
        self._back_at = -math.inf

    def add_stamp(self, stamp_ns: int, steady_time: float) -> Order:
        """Classify the stamp of a message, and update `publisher_conflict`.

        A step back is a stamp that is earlier than the stamp of the previous message. Its meaning
        depends on the number of publishers in the ROS graph:

        - One publisher: its clock was set back, and `publisher_conflict` is cleared.
        - Several publishers: for `DECIDED_AFTER` after the step back, every stamp earlier than the
          latest one is `MIXED`. A second step back within this time sets `publisher_conflict`.
          Without a second step back, a clock was set back. The first stamp after `DECIDED_AFTER`
          that is earlier than the latest one is then `BACK`.

        The latest stamp is the greatest one since a clock was last set back. While
        `publisher_conflict` is set, every stamp earlier than the latest one is `MIXED`.
        `publisher_conflict` is cleared `SECOND_PUBLISHER_TIMEOUT` after the last step back.

        Args:
            stamp_ns: Stamp by the publisher's clock [ns].
            steady_time: Time of receipt by the steady clock [s].

        Returns:
            `FORWARD` if the stamp is not earlier than the latest stamp. `BACK` if the clock was set
            back; this stamp then becomes the latest. `MIXED` if the caller must ignore the message,
            because it may come from another publisher.
        """
        steps_back, self._last_ns = stamp_ns < self._last_ns, stamp_ns
        if steps_back and not self._has_several_publishers(steady_time):
            self._latest_ns = stamp_ns
            return Order.BACK
        if self.publisher_conflict and steady_time - self._back_at > SECOND_PUBLISHER_TIMEOUT:
            self.publisher_conflict = ""
        if stamp_ns >= self._latest_ns:
            self._latest_ns = stamp_ns
            return Order.FORWARD
        if self.publisher_conflict or steady_time - self._back_at <= DECIDED_AFTER:
            return Order.MIXED
        self._latest_ns = stamp_ns
        return Order.BACK

    def _has_several_publishers(self, steady_time: float) -> bool:
        """Return whether the ROS graph shows several publishers, and update `publisher_conflict`.

        The method is called at each step back, that is, if a stamp is earlier than the previous
        stamp. The time of the step back is stored. With one publisher, `publisher_conflict` is
        cleared. With several, it is set if the previous step back was at most `DECIDED_AFTER` ago.

        Args:
            steady_time: Time of receipt of this stamp by the steady clock [s].

        Returns:
            True if there are several publishers.
        """
        several = self._several_publishers()
        if several and steady_time - self._back_at <= DECIDED_AFTER:
            self.publisher_conflict = several
        elif not several:
            self.publisher_conflict = ""
        self._back_at = steady_time
        return bool(several)
