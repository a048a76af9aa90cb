"""Order of the stamps of `reference`: detects a clock that was set back, and several publishers."""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import Enum

DECIDED_AFTER = 1.0
"""Time within which the stamps of two publishers go back at least a second time [s].

A reference comes at least twice a second, and a clock is not set back twice within this time.
"""

SECOND_PUBLISHER_TIMEOUT = 3.0
"""Time without a further step back of stamps after which there counts as being one publisher [s].
"""


class Order(Enum):
    """Conclusion from a stamp about the clocks of the publishers of a topic."""

    FORWARD = "later than all before"
    BACK = "the clock was set back"
    MIXED = "of a clock behind another one, or not decided yet"


class StampOrder:
    """Detector that distinguishes a clock set back from several publishers with other clocks.

    The stamps of one publisher go back once when its clock is set. With two publishers they go back
    again and again. The ROS graph shows a killed process for a while, so the number of publishers
    alone does not decide.

    Attributes:
        publisher_conflict: Sentence that names several publishers whose clocks differ; empty
            without them.
    """

    def __init__(self, several_publishers: Callable[[], str]) -> None:
        """Begin without a stamp.

        Args:
            several_publishers: Function that asks the ROS graph. It returns a sentence that names
                the publishers if there are several, otherwise an empty text. It is called at each
                step back of the stamps.
        """
        self.publisher_conflict = ""
        self._several_publishers = several_publishers
        self._last_ns = -1
        self._latest_ns = -1
        self._back_at = -math.inf

    def add_stamp(self, stamp_ns: int, steady_time: float) -> Order:
        """Classify the stamp of a message, and update `publisher_conflict`.

        A step back is a stamp that is earlier than the stamp of the message before. What it means
        depends on the publishers that the ROS graph shows:

        - One publisher: its clock was set back, and `publisher_conflict` is cleared.
        - Several publishers: for `DECIDED_AFTER` after the step back, every stamp earlier than the
          latest one is `MIXED`. A second step back within this time sets `publisher_conflict`.
          Without it, a clock was set back: the next stamp that is earlier than the latest one is
          `BACK`.

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
        """Return whether the ROS graph shows several publishers, after a stamp that went back.

        A stamp went back if it is earlier than the stamp before it. The time of this event is
        stored. With one publisher, `publisher_conflict` is cleared. With several, it is set if the
        previous such event was at most `DECIDED_AFTER` ago.

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
