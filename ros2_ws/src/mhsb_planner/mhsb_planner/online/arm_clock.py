"""The arm's clock: its time and speed from stamps, and whether it was set back.

Plans are stamped by the arm's clock. This clock may run faster or slower than real time, for
example in a simulator. So times of plans are computed by the arm's clock. The steady clock is the
planner's own clock, which is never set.
"""

import math
from collections import deque
from collections.abc import Callable
from enum import Enum

from mhsb_model.trajectory import SECOND_NS

STAMP_WINDOW = 1.0
"""Age up to which a stamp is used to compute the time of the arm's clock [s].

The age is relative to the latest kept stamp. The least delayed of these stamps counts.
"""

SPEED_WINDOW = 3.0
"""Age up to which a stamp is used to compute the speed of the arm's clock [s]."""

SHORTEST_SPAN = 0.3
"""Shortest span between two stamps from which a speed is computed [s].

A shorter span gives no reliable speed.
"""

STAMP_SPACING = 0.02
"""Length of a time slot [s]. Only the least delayed stamp of each slot is kept."""

MIN_CLOCK_JUMP = 1.0
"""Least time by which a stamp is ahead of its expected time if the clock has jumped [s]."""

MAX_UNIT_RATE_DEVIATION = 0.1
"""Largest deviation of a clock's speed from 1 that is explained by delays of messages [-]."""

DECIDED_AFTER = 1.0
"""Largest time between two steps back of stamps that indicates several publishers [s].

With two publishers, which send references at least twice a second, the stamps go back more often. A
clock is not set back twice within this time.
"""

SECOND_PUBLISHER_TIMEOUT = 3.0
"""Time without a further step back of stamps after which a second publisher counts as gone [s]."""


class ArmClockEstimator:
    """Estimator of the arm's clock [ns] at a time of the steady clock [s]."""

    def __init__(self) -> None:
        """Begin without a stamp."""
        self.forget()

    def forget(self) -> None:
        """Forget all stamps, because another arm sends them or the arm was restarted."""
        self._stamps: deque[tuple[float, int]] = deque()
        self._last: tuple[float, int] | None = None

    def add_stamp(self, stamp_ns: int, steady_time: float) -> bool:
        """Add a stamp, and return whether it is not earlier than the previous stamp.

        All earlier stamps are forgotten if the arm's clock has gone back or has jumped ahead. It
        has jumped ahead if the stamp is more than `MIN_CLOCK_JUMP` later than expected from the
        earlier stamps. In each time slot of `STAMP_SPACING` only the least delayed stamp is kept.
        Stamps older than `SPEED_WINDOW` are forgotten.

        Args:
            stamp_ns: Stamp by the arm's clock [ns].
            steady_time: Time of receipt by the steady clock [s].

        Returns:
            False if the stamp is earlier than the previous stamp; True otherwise, even after a jump
            ahead.
        """
        went_back = self._last is not None and stamp_ns < self._last[1]
        if went_back or self._jumps_ahead(stamp_ns, steady_time):
            self.forget()
        self._last = (steady_time, stamp_ns)
        if not self._stamps or steady_time // STAMP_SPACING != self._stamps[-1][0] // STAMP_SPACING:
            self._stamps.append(self._last)
        else:
            kept, kept_ns = self._stamps[-1]
            if stamp_ns - kept_ns > self.speed * (steady_time - kept) * SECOND_NS:
                self._stamps[-1] = self._last
        while steady_time - self._stamps[0][0] > SPEED_WINDOW:
            self._stamps.popleft()
        return not went_back

    def keep_last_stamp_only(self) -> None:
        """Forget all stamps but the latest stamp.

        The caller uses this if the extrapolated time turns out to be ahead of the arm's clock.
        """
        if self._last is not None:
            self._stamps = deque([self._last])

    def _jumps_ahead(self, stamp_ns: int, steady_time: float) -> bool:
        """Return whether a stamp is more than `MIN_CLOCK_JUMP` ahead of its expected time.

        The expected time is the last stamp, extrapolated at the estimated speed of the arm's clock.

        Args:
            stamp_ns: Stamp by the arm's clock [ns].
            steady_time: Time of receipt by the steady clock [s].

        Returns:
            True if the stamp is too far ahead. Always False for the first stamp.
        """
        if self._last is None:
            return False
        last, last_ns = self._last
        return (stamp_ns - last_ns) / SECOND_NS > self.speed * (steady_time - last) + MIN_CLOCK_JUMP

    @property
    def last_stamp_ns(self) -> int | None:
        """Last stamp by the arm's clock [ns]; None if there was none."""
        return None if self._last is None else self._last[1]

    def time_since_last_stamp(self, steady_time: float) -> float:
        """Return the time since the last stamp was received [s]; infinite if there was none.

        Args:
            steady_time: Present time by the steady clock [s].
        """
        return math.inf if self._last is None else steady_time - self._last[0]

    @property
    def speed(self) -> float:
        """Speed of the arm's clock: seconds on that clock per second of the steady clock [-].

        The speed is the slope between the first and the last kept stamp, over at most SPEED_WINDOW.
        It is 1 if the two stamps are less than SHORTEST_SPAN apart, or if the slope deviates from 1
        by at most MAX_UNIT_RATE_DEVIATION.
        """
        if not self._stamps:
            return 1.0
        (first, first_ns), (last, last_ns) = self._stamps[0], self._stamps[-1]
        if last - first < SHORTEST_SPAN:
            return 1.0
        speed = (last_ns - first_ns) / SECOND_NS / (last - first)
        return 1.0 if abs(speed - 1.0) <= MAX_UNIT_RATE_DEVIATION else speed

    def convert_duration(self, seconds: float) -> float:
        """Convert a real duration to a duration by the arm's clock.

        The duration is multiplied by the estimated speed of the arm's clock, or by 1 if this speed
        is below 1.

        Args:
            seconds: Duration by the steady clock [s].

        Returns:
            Duration by the arm's clock [s], not shorter than `seconds`.
        """
        return seconds * max(1.0, self.speed)

    def extrapolate_ns(self, steady_time: float) -> int:
        """Extrapolate the arm's clock to the present.

        Each stamp that is at most `STAMP_WINDOW` older than the latest stamp is extrapolated at the
        estimated speed of the clock. The latest of these times is returned, since it comes from the
        least delayed stamp.

        Args:
            steady_time: Present time by the steady clock [s].

        Returns:
            Present time by the arm's clock [ns].

        Raises:
            ValueError: No stamp has been received.
        """
        if not self._stamps:
            raise ValueError("no stamp of the arm has been heard")
        speed, latest = self.speed, self._stamps[-1][0]
        times = []
        for heard, stamp_ns in reversed(self._stamps):
            if latest - heard > STAMP_WINDOW:
                break
            times.append(stamp_ns + round(speed * (steady_time - heard) * SECOND_NS))
        return max(times)


class Order(Enum):
    """Conclusion from the stamp of a message about the clocks of the publishers of its topic."""

    FORWARD = "later than all before"
    BACK = "the clock was set back"
    MIXED = "of a clock behind another one, or not decided yet"


class StampOrder:
    """Detector of the cause of earlier stamps: a clock set back, or publishers with other clocks.

    The stamps of one publisher go back once when its clock is set back. With two publishers they go
    back again and again. The number of publishers in the ROS graph is not sufficient, because the
    graph still shows a killed process for a while.

    Attributes:
        publisher_conflict: Sentence that names several publishers whose clocks differ; empty
            without them.
    """

    def __init__(self, several_publishers: Callable[[], str]) -> None:
        """Begin without a stamp.

        Args:
            several_publishers: Function without arguments, called if a stamp is earlier than the
                previous one. It returns a sentence with the names of the publishers if the ROS
                graph shows several, else an empty text.
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
          latest stamp is `MIXED`. A second step back within this time sets `publisher_conflict`.
          Without a second step back, a clock was set back: the first later stamp that is earlier
          than the latest stamp is `BACK`.

        The latest stamp is the greatest stamp since a clock was last set back. While
        `publisher_conflict` is set, every stamp earlier than the latest stamp is `MIXED`.
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
        cleared. With several publishers, it is set if the previous step back was at most
        `DECIDED_AFTER` ago.

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
