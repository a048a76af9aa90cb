"""Deadline of an answer: one instant for everything that is done to get it.

    deadline = Deadline.after(0.08)
    planner.plan(goal, start, deadline=deadline.earlier_by(0.005))

A deadline is an absolute instant, so it is passed on unchanged. Every callee sees the time that is
left, whatever was done before. `progress.PlanProgress` is the
part of that time that a search may take.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass

from mhsb_planner.errors import DeadlineError

CLOCK_CHECK_PERIOD = 1e-3
"""Time that the work between two readings of the clock should take [s]."""


def now() -> float:
    """Return the time of the clock that deadlines refer to [s]: `time.monotonic`."""
    return time.monotonic()


@dataclass(frozen=True, order=True)
class Deadline:
    """Instant at which an answer is due.

    Attributes:
        instant: Time of the clock `now` [s]; infinite: no deadline.
    """

    instant: float

    def __post_init__(self) -> None:
        """Raise ValueError if the instant is NaN."""
        if math.isnan(self.instant):
            raise ValueError("a deadline must be an instant, not NaN")

    @classmethod
    def after(cls, seconds: float) -> Deadline:
        """Return the deadline that lies a given time after now.

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
            reserve: Time to keep for what has to be done afterwards [s]. A negative time gives a
                later deadline.

        Returns:
            The deadline.
        """
        return self if reserve == 0.0 else Deadline(self.instant - reserve)

    def check(self, work: str) -> None:
        """Raise an error if the deadline has passed.

        Args:
            work: Work that cannot go on, as the subject of the error's sentence.

        Raises:
            DeadlineError: The deadline has passed.
        """
        if now() >= self.instant:
            raise DeadlineError(work)

    def portions(self, first: int, most: int) -> Iterator[int]:
        """Yield sizes of portions of work until the deadline has passed.

        The consumer does one portion before it requests the next size. The generator measures this
        time. It adapts the size so that a portion takes about CLOCK_CHECK_PERIOD. Without a
        deadline it yields `most` without end.

        Args:
            first: Size of the first portion, a number of units such as expanded states.
            most: Largest size of a portion.

        Yields:
            Sizes, at least 1.
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
