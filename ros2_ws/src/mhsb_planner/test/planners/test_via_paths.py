"""Legs to via points, from a source that proposes nothing and raises nothing."""

import pytest

from mhsb_planner.deadline import NO_DEADLINE, Deadline
from mhsb_planner.errors import DeadlineError
from mhsb_planner.planners.via_paths import plan_leg
from mhsb_planner.progress import PlanProgress


class SilentSource:
    """Source of no paths."""

    def paths(self, request, progress):
        return iter(())


@pytest.mark.parametrize("cheapest", [False, True])
@pytest.mark.parametrize(
    ("deadline", "error", "sentence"),
    [
        (NO_DEADLINE, ValueError, "a planner that gives no path must say why"),
        (Deadline.after(-1.0), DeadlineError, "before the deadline"),
    ],
)
def test_a_leg_without_any_path_says_whether_time_was_up_or_the_planner_is_at_fault(
    cheapest, deadline, error, sentence
):
    with pytest.raises(error, match=sentence):
        plan_leg(SilentSource(), None, PlanProgress(deadline), cheapest)
