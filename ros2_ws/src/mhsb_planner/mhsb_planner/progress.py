"""State of the planning loop that the searches for paths read: deadlines, and progress so far."""

import math
from dataclasses import dataclass, field

from mhsb_planner.deadline import NO_DEADLINE, Deadline, now
from mhsb_planner.plan_log import PlanLog


@dataclass
class PlanProgress:
    """State of the planning loop for one plan, which the searches for paths read.

    Only the planning loop (`planning.loop`) and `planning.first_moves` change it. Searches read it
    and add to the log.

    Attributes:
        deadline: Deadline of the whole plan.
        reserve: Time that is kept for the fit of a motion to a path [s]. The reserve is the mean
            time of the curves that were tried for the first motion.
        has_motion: True if a motion has been found.
        min_speed_factor: Estimated factor on V_max (allowed piston speed), 0 to 1 [-]. Motions
            planned for a lower speed will not be cheaper than the incumbent (cheapest plan so far).
            It is 0 if there is no incumbent, or if the incumbent costs much more than the cheapest
            path.
        max_path_cost: Largest cost, without mode switches, of a path whose motion may be cheaper
            than the incumbent [-]. The loop skips dearer paths. It is inf if there is no incumbent.
        log: Log of proposals.
        trial_deadline: Earlier deadline of a search whose failure leaves time for another search.
            None means `deadline`.
    """

    deadline: Deadline = NO_DEADLINE
    reserve: float = 0.0
    has_motion: bool = False
    min_speed_factor: float = 0.0
    max_path_cost: float = math.inf
    log: PlanLog = field(default_factory=PlanLog)
    trial_deadline: Deadline | None = None
    _began: float = field(default_factory=now, init=False)

    @property
    def has_deadline(self) -> bool:
        """True if there is a deadline."""
        return self.deadline != NO_DEADLINE

    @property
    def is_half_over(self) -> bool:
        """True if less time is left until `search_deadline` than has passed since creation.

        False if there is no deadline.
        """
        return now() - self._began > self.search_deadline.remaining

    @property
    def search_deadline(self) -> Deadline:
        """Deadline of the search: earlier by `reserve` than `deadline` or `trial_deadline`.

        If a path is found later, no motion can be fitted to it in time.
        """
        return (self.trial_deadline or self.deadline).earlier_by(self.reserve)
