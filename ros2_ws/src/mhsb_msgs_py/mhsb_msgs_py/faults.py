"""Faults of a node's callbacks: exceptions that no lower layer has turned into a refusal.

They are logged and counted for /diagnostics. Repeated faults of a callback that monitors a motion
stop the arm. `guarded_executor` reports the faults of callbacks that the executor calls. Other
callbacks are wrapped by `Faults.wrap`.
"""

import functools
import re
import time
import traceback
from collections.abc import Callable
from typing import Any

from rclpy.node import Node

from mhsb_msgs_py.errors import MessageError

IN_A_ROW_TO_STOP = 3
"""Number of faults in a row of a callback that monitors the plan after which the arm is stopped."""

STOP_PERIOD = 1.0
"""Time between two stops while a watched callback goes on failing [s]."""

LOG_PERIOD = 10.0
"""Time between two log lines on faults of one kind [s]."""

MOST_KINDS = 1000
"""Largest number of kinds of faults that are logged separately.

A kind is a callback, an exception type and a place in the code; there are usually fewer.
"""

DEEPEST_TRACE, LONGEST_TRACE = 30, 8000
"""Largest numbers of calls and of characters of a traceback in the log."""

SHOWN_FOR = 60.0
"""Time for which a node's status warns of its last fault [s]."""

CAPITAL_PATTERN = re.compile("[A-Z]")
"""Pattern at which a class name is split into words."""


class Faults:
    """Record of the faults in the callbacks of one node.

    Attributes:
        count: Number of faults since the start.
        last: Sentence that describes the last fault; empty if there was none.
        ending_errors: Types of exceptions that are meant to end the node.
    """

    def __init__(
        self,
        node: Node,
        stop: Callable[[], object] | None = None,
        ending_errors: tuple[type[Exception], ...] = (),
    ) -> None:
        """Make an empty record.

        Args:
            node: Node whose log is written.
            stop: Function that brings the arm to rest. It is called if a watched callback fails
                repeatedly. None: nothing is called.
            ending_errors: Types of exceptions that are meant to end the node; these exceptions are
                raised again.
        """
        self.count = 0
        self.last = ""
        self.ending_errors = ending_errors
        self._node = node
        self._stop = stop
        self._watched: set[str] = set()
        self._in_a_row: dict[str, int] = {}
        self._logged_at: dict[tuple[str, ...], float] = {}
        self._last_at = self._stopped_at = -float("inf")

    def watch(self, *entities: Any) -> None:
        """Watch callbacks, so that the arm is stopped if one of them fails repeatedly.

        The arm is stopped after IN_A_ROW_TO_STOP failures of one callback in a row.

        Args:
            *entities: Subscriptions or timers whose callbacks are watched.
        """
        self._watched.update(map(name_callback, entities))

    def record_fault(self, place: str, error: Exception) -> str:
        """Log and count a fault, and stop the arm if a watched callback fails repeatedly.

        The arm is stopped after IN_A_ROW_TO_STOP failures of this callback in a row. Faults of one
        kind (callback, exception type and place in the code) are logged at most once in LOG_PERIOD.

        Args:
            place: Name of the callback that failed, as `name_callback` gives it.
            error: Exception that the callback raised.

        Returns:
            One sentence for a client that waits for an answer.

        Raises:
            Exception: `error` itself, in two cases: it is meant to end the node, or ROS has been
                shut down.
        """
        if isinstance(error, self.ending_errors) or not self._node.context.ok():
            raise error
        sentence = str(MessageError(f"a fault in {place}: {_describe_error(error)}"))
        self.count += 1
        self.last, self._last_at = sentence, time.monotonic()
        self._log(place, error, sentence)
        if place in self._watched:
            self._count_in_a_row(place)
        return f"{sentence}; the log of {self._node.get_name()} says more"

    def record_success(self, entity: Any) -> None:
        """Record that the callback of a subscription or timer has succeeded.

        Its number of faults in a row is set to 0.

        Args:
            entity: The subscription or timer.
        """
        if self._in_a_row:
            self._in_a_row.pop(name_callback(entity), None)

    def wrap(self, place: str, callback: Callable[..., None]) -> Callable[..., None]:
        """Wrap a callback so that its exceptions are recorded as faults.

        Use it for callbacks that rclpy's executor does not call itself.

        Args:
            place: Name of the callback, for the record.
            callback: The callback.

        Returns:
            The wrapped callback. It takes the same arguments and returns nothing. It raises only
            what `record_fault` raises.
        """

        @functools.wraps(callback)
        def guarded(*arguments: Any) -> None:
            """Call the callback, and record its exception."""
            try:
                callback(*arguments)
            except Exception as error:
                self.record_fault(place, error)

        return guarded

    def get_recent_fault(self) -> str:
        """Return the sentence on the latest fault; empty `SHOWN_FOR` seconds after the fault."""
        return self.last if time.monotonic() - self._last_at < SHOWN_FOR else ""

    def _count_in_a_row(self, place: str) -> None:
        """Count a failure of a watched callback, and stop the arm after too many in a row.

        The arm is stopped at the failure number `IN_A_ROW_TO_STOP` in a row. While the callback
        goes on failing, the stop is repeated, at most once in `STOP_PERIOD`. An exception of the
        stop itself is recorded as a fault. Without a function `stop`, failures are only counted.

        Args:
            place: Name of the callback.
        """
        count = self._in_a_row[place] = self._in_a_row.get(place, 0) + 1
        now = time.monotonic()
        if count < IN_A_ROW_TO_STOP or self._stop is None or now - self._stopped_at < STOP_PERIOD:
            return
        self._stopped_at = now
        self._node.get_logger().error(
            f"the arm is to stop: {place} has failed {count} times in a row, so nobody watches the "
            "motion"
        )
        try:
            self._stop()
        except Exception as error:
            self.record_fault("the stop after repeated faults", error)

    def _log(self, place: str, error: Exception, sentence: str) -> None:
        """Log a fault if no fault of its kind was logged within the last `LOG_PERIOD`.

        Two faults are of one kind if callback, exception type and place in the code are equal. The
        first fault of a kind is logged with its traceback, later ones as one line. After
        `MOST_KINDS` kinds, all are forgotten, so that each is logged with a traceback again.

        Args:
            place: Name of the callback.
            error: Exception that it raised.
            sentence: The fault in words.
        """
        frames = traceback.extract_tb(error.__traceback__, limit=-1)
        kind = (place, type(error).__name__, *(f"{each.filename}:{each.lineno}" for each in frames))
        now = time.monotonic()
        logged_at = self._logged_at.get(kind)
        if logged_at is not None and now - logged_at < LOG_PERIOD:
            return
        if len(self._logged_at) >= MOST_KINDS:
            self._logged_at.clear()
        self._logged_at[kind] = now
        details = "" if logged_at is not None else f"\n{_format_traceback(error)}"
        self._node.get_logger().error(f"{sentence} (fault {self.count}; the node goes on){details}")


def name_callback(entity: Any) -> str:
    """Return the name of a callback for the record of faults.

    Args:
        entity: The subscription, service, timer or other object that the executor serves.

    Returns:
        A name such as "the topic /reference", "the service /mhsb_planner/stop" or "the timer
        on_timer".
    """
    for attribute, kind in (("topic_name", "topic"), ("service_name", "service")):
        if hasattr(entity, attribute):
            return f"the {kind} {getattr(entity, attribute)}"
    kind = CAPITAL_PATTERN.sub(r" \g<0>", type(entity).__name__).strip().lower()
    name = getattr(getattr(entity, "callback", None), "__name__", "")
    return f"the {kind} {name.strip('_')}".rstrip()


def _describe_error(error: Exception) -> str:
    """Return type and text of an exception, such as "ValueError: no such joint".

    Args:
        error: The exception.

    Returns:
        Type and text; the type alone if the exception's own conversion to text fails.
    """
    try:
        return f"{type(error).__name__}: {error}"
    except Exception:
        return type(error).__name__


def _format_traceback(error: Exception) -> str:
    """Return the innermost calls of a traceback, with the exception's text.

    Args:
        error: The exception.

    Returns:
        The last `LONGEST_TRACE` characters of the text, which has at most `DEEPEST_TRACE` calls. If
        no traceback can be made, a remark that says so.
    """
    try:
        lines = traceback.format_exception(error, limit=-DEEPEST_TRACE)
    except Exception as second:
        lines = [f"(no traceback: {type(second).__name__})"]
    return "".join(lines).rstrip()[-LONGEST_TRACE:]
