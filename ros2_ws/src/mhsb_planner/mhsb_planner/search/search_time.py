"""How long a search for paths may go on while a plan is made."""

from __future__ import annotations

from dataclasses import dataclass, field

from mhsb_planner.deadline import NEVER, Deadline, now


@dataclass
class SearchTime:
    """What the search may take of the time that there is for a plan.

    Whoever makes motions of the paths keeps it up to date; the search looks at it.

    deadline  of the whole plan
    reserve   s, that making a motion of a path has taken so far, for each curve that was tried
    found     whether there is a motion already
    """

    deadline: Deadline = NEVER
    reserve: float = 0.0
    found: bool = False
    _began: float = field(default_factory=now, init=False)

    @property
    def ends(self) -> bool:
        """Whether there is a deadline at all."""
        return self.deadline != NEVER

    @property
    def half_gone(self) -> bool:
        """Whether less than half of the time is left."""
        return now() - self._began > self.until.left

    @property
    def until(self) -> Deadline:
        """When to end: what is found later can no longer be made a motion."""
        return self.deadline.less(self.reserve)
