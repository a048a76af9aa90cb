"""Progress of the making of one plan, which searches read while the planning loop updates it."""

from __future__ import annotations

from dataclasses import dataclass, field

from mhsb_planner.deadline import NO_DEADLINE, Deadline, now
from mhsb_planner.plan_log import PlanLog


@dataclass
class PlanProgress:
    """Progress of the making of one plan, as far as searches may know it.

    The planning loop (`planning.loop`) updates it; everything else only reads it and adds to the
    log.

    Attributes:
        deadline: Deadline of the whole plan.
        reserve: Time to keep for turning a path into a motion: mean time of the curves that were
            tried for the first motion [s].
        has_motion: True if a motion has been found already.
        is_held_back: True if motions cannot keep up with their paths: a path costs much less than
            the incumbent, or there are paths and no motion yet.
        log: Log of proposals.
    """

    deadline: Deadline = NO_DEADLINE
    reserve: float = 0.0
    has_motion: bool = False
    is_held_back: bool = False
    log: PlanLog = field(default_factory=PlanLog)
    _began: float = field(default_factory=now, init=False)

    @property
    def has_deadline(self) -> bool:
        """True if there is a deadline."""
        return self.deadline != NO_DEADLINE

    @property
    def is_half_over(self) -> bool:
        """True if less time is left until `search_deadline` than has passed since creation.

        Without a deadline it is False.
        """
        return now() - self._began > self.search_deadline.remaining

    @property
    def search_deadline(self) -> Deadline:
        """Deadline of the search: `deadline` less `reserve`.

        A path that is found later could no longer be made a motion in time.
        """
        return self.deadline.earlier_by(self.reserve)
