"""How well goals were replanned online: the figures of `scripts/bench online`, of a recording."""

from __future__ import annotations

from collections.abc import Sequence

from mhsb_sim.recording.recording import Recording
from mhsb_sim.report.departures import departures
from mhsb_sim.report.goal_fates import Fate, GoalFate, goal_fates
from mhsb_sim.report.summary import Summary, jumps, real_time_factor, spread

PER_MS = 1e-6  # of nanoseconds


def online_figures(recording: Recording) -> Summary:
    """Figures of a recording of goals to all of which there is a way.

    applied, superseded, lost  sum up to `goals`
    retried       goals for which more than one plan was sent
    deadline      goals refused or aborted because no plan could be sent in time
    lead_ms       goal received to where its plan left the old one, as the planner tells
    lead_seen_ms  goal sent to where its plan left the old one, as the messages show, ROS time
    plan_ms       goal received to plan published
    """
    fates = goal_fates(recording, all_feasible=True)
    number = {fate: sum(each.fate is fate for each in fates) for fate in Fate}
    made = [each.verdict.plan for each in fates if each.verdict and not each.continued]
    return {
        "goals": len(fates),
        "applied": number[Fate.APPLIED],
        "retried": sum(each.retried for each in fates),
        "lost": number[Fate.LOST],
        "deadline": sum(each.out_of_time for each in fates),
        "superseded": number[Fate.SUPERSEDED],
        "real_time_factor": real_time_factor(recording),
        **jumps(recording),
        "lead_ms": spread(each.lead_ms for each in fates),
        "lead_seen_ms": spread(leads_seen(recording, fates)),
        "plan_ms": spread(plan.plan_ms for plan in made if plan and plan.plan_stamp_ns),
        "lost_because": [each.reason for each in fates if each.fate is Fate.LOST],
    }


def leads_seen(recording: Recording, fates: Sequence[GoalFate]) -> list[float]:
    """From goal sent to where its plan leaves the old one, by the messages themselves [ms].

    In ROS time; says what `lead_ms` should say, whatever the planner does.
    """
    left_ns = departures(recording)
    return [
        PER_MS * (left_ns[each.plan_stamp_ns] - each.sent.time_ns)
        for each in fates
        if each.plan_stamp_ns in left_ns and not each.continued
    ]
