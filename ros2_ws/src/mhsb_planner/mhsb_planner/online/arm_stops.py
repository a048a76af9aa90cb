"""Stops of the arm by its own service ~/stop, and goals that such a stop makes void."""

from collections import deque
from collections.abc import Callable

from mhsb_model.trajectory import SECOND_NS
from mhsb_planner.online.lifecycle_state import LifecycleState

OWN_REPORT = 2.0
"""Time after this planner's call of ~/stop within which the arm reports the stop [s]."""

OLD_STOP = 1.0
"""Time after a stop within which goals are void if they were sent before the report of the stop
[s].

It covers the delay with which the arm's clock is known from its messages."""

LATE_REPORT = 0.1
"""Delay of a stop's report above which this process must have been suspended [s].

A report takes some milliseconds even if the planner is busy, because the middleware receives it. A
process that was suspended gets all messages at once when it continues, in any order.
"""


class ArmStops:
    """Record of this planner's calls of the arm's ~/stop, and of the stop that the arm reported."""

    def __init__(self, state: LifecycleState) -> None:
        """Begin without a call and without a report.

        Args:
            state: State of the lifecycle, for the time of plans and the outbox.
        """
        self._state = state
        self._unreported_calls: deque[float] = deque()
        self._last_stop_ns: int | None = None

    def call(self, on_answer: Callable[[bool, str], None]) -> bool:
        """Call the arm's own ~/stop once, and store the time of the call.

        Args:
            on_answer: Called with success and sentence when the arm answers.

        Returns:
            True if the service was called, False if it is not available.
        """
        if not self._state.outbox.stop_arm(on_answer):
            return False
        self._unreported_calls.append(self._state.now)
        return True

    def find_void_time(
        self, stop_ns: int, age: float = 0.0, received_at: float | None = None
    ) -> float | None:
        """Find the time up to which goals are void, from the arm's report of its last stop.

        A goal is void if it was sent before the report was received, and at most `OLD_STOP` after
        the stop. With the first report that the planner receives, only goals sent before the stop
        are void, because the first messages may be seconds old.

        A stop that this planner has called for makes no goal void. The report is ascribed to the
        oldest call without a report, unless the stop came more than `OLD_STOP` before this call.
        All calls are forgotten if the latest call is more than `OWN_REPORT` ago.

        If the report came more than `LATE_REPORT` after its stop, this process was suspended. Goals
        that came during this time may still be unread. The report then counts as received
        `LATE_REPORT` later than now, so that these goals are also void.

        The method stores the time of the stop, and removes the call to which the report is
        ascribed.

        Args:
            stop_ns: Time of the stop by the arm's clock [ns]; 0 means never.
            age: Time from the stop to the report, by the arm's clock [s].
            received_at: Time of receipt of the report by the steady clock [s]; None means now.

        Returns:
            Latest time at which a void goal was sent, by the steady clock [s]. None if there was no
            stop, if the stop was reported before, or if this planner has called for it.
        """
        state, now = self._state, self._state.now
        before, self._last_stop_ns = self._last_stop_ns, stop_ns
        if stop_ns in (0, before):
            return None
        received_at = now if received_at is None else received_at
        speed = state.arm_state.clock_estimator.convert_duration(1.0)
        ago = (state.now_ns + state.arm_state.plan_delay_ns - stop_ns) / SECOND_NS / speed
        ago = max(ago, age / speed + now - received_at)
        if self._unreported_calls and now - self._unreported_calls[-1] > OWN_REPORT:
            self._unreported_calls.clear()
        if self._unreported_calls and now - ago + OLD_STOP > self._unreported_calls[0]:
            self._unreported_calls.popleft()
            return None
        if ago - (now - received_at) > LATE_REPORT:
            received_at = now + LATE_REPORT
        return min(received_at, now - ago + (OLD_STOP if before is not None else 0.0))
