"""The instant by which an answer is wanted, one for everything that is done to get it.

    deadline = Deadline.after(0.08)
    planner.plan(goal, start, deadline=deadline.less(0.005))

Being absolute, it is handed on as it is: whoever gets it sees what is left, whatever was done
before.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass


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


NEVER = Deadline(math.inf)
