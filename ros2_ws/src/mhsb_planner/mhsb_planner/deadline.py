"""The instant by which an answer is wanted, one for everything that is done to get it.

    deadline = Deadline.after(0.08)
    planner.plan(goal, start, deadline=deadline.less(0.005))

Being absolute, it is handed on as it is: whoever gets it sees what is left, whatever was done
before.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass

from mhsb_planner.errors import DeadlineError

PORTION = 1e-3
"""What is done between two looks at the clock is to take about so long [s]."""


def now() -> float:
    """The clock that deadlines are instants of [s]: `time.monotonic`."""
    return time.monotonic()


@dataclass(frozen=True, order=True)
class Deadline:
    """An instant of `now` [s]; infinite where there is no hurry."""

    instant: float

    def __post_init__(self) -> None:
        if math.isnan(self.instant):
            raise ValueError("a deadline must be an instant, not NaN")

    @classmethod
    def after(cls, seconds: float) -> Deadline:
        """So many seconds from now; infinite gives NEVER, zero or less one that has passed."""
        return cls(now() + seconds)

    @property
    def left(self) -> float:
        """Time until then [s]; negative once it has passed."""
        return self.instant - now()

    @property
    def passed(self) -> bool:
        """Whether the time is up."""
        return now() >= self.instant

    def less(self, reserve: float) -> Deadline:
        """So many seconds earlier, for what is to be done afterwards."""
        return Deadline(self.instant - reserve)

    def check(self, work: str) -> None:
        """Raise DeadlineError if it has passed; `work` is what cannot go on."""
        if self.passed:
            raise DeadlineError(work)

    def portions(self, first: int, most: int) -> Iterator[int]:
        """How much to do before the next look at the clock, again and again until it has passed.

        Each portion is to be done before the next is asked for. From the time that one took
        follows the size of the next, at most `most`; where there is no hurry, all are of that.
        """
        if self.instant == math.inf:
            while True:
                yield most
        size = first
        while not self.passed:
            began = now()
            yield size
            took = max(now() - began, 0.1 * PORTION)
            size = max(1, min(most, round(size * PORTION / took)))


NEVER = Deadline(math.inf)
