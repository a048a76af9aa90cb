"""Deadline of an answer: one instant for all functions that work on the answer.

    deadline = Deadline.after(0.08)
    planner.plan(goal, start, deadline=deadline.earlier_by(0.005))

A deadline is passed on unchanged, and every called function can compute the time that is left. The
deadline of the search, in `progress.PlanProgress`, is earlier.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass

from mhsb_planner.errors import DeadlineError

CLOCK_CHECK_PERIOD = 1e-3
"""Intended duration of the work between two readings of the clock [s]."""


def now() -> float:
    """Return the present time [s] by `time.monotonic`, the clock of all deadlines."""
    return time.monotonic()


@dataclass(frozen=True, order=True)
class Deadline:
    """Instant at which an answer must be ready.

    Attributes:
        instant: Time by the clock of `now` [s]. Infinity means no deadline.
    """

    instant: float

    def __post_init__(self) -> None:
        """Check that the instant is not NaN.

        Raises:
            ValueError: The instant is NaN.
        """
        if math.isnan(self.instant):
            raise ValueError("a deadline must be an instant, not NaN")

    @classmethod
    def after(cls, seconds: float) -> Deadline:
        """Create a deadline at a given time from now.

        Args:
            seconds: Time [s]. Infinity gives NO_DEADLINE; 0 or less gives a deadline that has
                passed.

        Returns:
            The deadline.
        """
        return cls(now() + seconds)

    @property
    def remaining(self) -> float:
        """Time until the deadline [s]; negative after it."""
        return self.instant - now()

    @property
    def has_passed(self) -> bool:
        """True if the deadline has passed."""
        return now() >= self.instant

    def earlier_by(self, reserve: float) -> Deadline:
        """Return an earlier deadline.

        Args:
            reserve: Time that is kept for other work afterwards [s]. A negative time gives a later
                deadline.

        Returns:
            The deadline.
        """
        return self if reserve == 0.0 else Deadline(self.instant - reserve)

    def check(self, work: str) -> None:
        """Check that the deadline has not passed.

        Args:
            work: Name of the work that has this deadline. It is the subject of the error's
                sentence.

        Raises:
            DeadlineError: The deadline has passed.
        """
        if now() >= self.instant:
            raise DeadlineError(work)

    def portions(self, first: int, most: int) -> Iterator[int]:
        """Yield sizes of portions of work until the deadline has passed.

        The consumer does one portion of work before it requests the next size. The generator
        measures the time of the portion. It then adapts the size so that a portion takes about
        CLOCK_CHECK_PERIOD. A size is at most ten times the previous size. Without a deadline, the
        generator never ends, and all sizes are `most`.

        Args:
            first: Size of the first portion, as a number of units such as expanded states.
            most: Largest size of a portion.

        Yields:
            Number of units in the next portion, at least 1.
        """
        if self.instant == math.inf:
            while True:
                yield most
        size = first
        while not self.has_passed:
            began = now()
            yield size
            took = max(now() - began, 0.1 * CLOCK_CHECK_PERIOD)
            size = max(1, min(most, round(size * CLOCK_CHECK_PERIOD / took)))


NO_DEADLINE = Deadline(math.inf)
"""Deadline that never passes."""
