"""Quality of online replanning in a recording: the numbers of `scripts/bench online`."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.departures import find_branch_times

from mhsb_model.verdict import Verdict
from mhsb_tools.recording.recording import Recording
from mhsb_tools.report.goal_fates import GoalResult, JudgedGoal, judge_recorded_goals
from mhsb_tools.report.summary import (
    Summary,
    compute_quantiles,
    compute_real_time_factor,
    compute_reference_jumps,
)

PER_MS = 1e-6
"""Milliseconds per nanosecond."""


def compute_replanning_figures(recording: Recording) -> Summary:
    """Compute counts of goals, response times and jumps of the reference of online replanning.

    All goals are taken to be feasible, whatever their verdicts say. A goal whose message is not in
    the recording does not count: it was sent before the run, to find out whether nodes answer.

    Args:
        recording: Recording of goals to all of which a path exists.

    Returns:
        Numbers by name. Durations are given as `p50`, `p99` and `max`, each None without data.

        - `goals`: Number of these goals, the sum of `applied`, `superseded` and `lost`.
        - `retried`: Goals for which more than one plan was sent.
        - `deadline`: Goals refused or aborted because no plan could be sent in time.
        - `lead_ms`: Goal received to the instant at which its plan left the old one, by the
            planner.
        - `lead_seen_ms`: Goal sent to the instant at which its plan left the old one, by the
            messages, in ROS time.
        - `plan_ms`: Goal received to plan published, without goals that needed no new plan.
        - `real_time_factor`: Simulated over real time; None without data.
        - `reference_jump_max_rad`, `reference_jump_max_rad_s`: Largest steps of the reference at
            hand-overs.
        - `lost_because`: One sentence for each lost goal. Stopped goals count as lost: the
            benchmark stops none.
    """
    sent = {each.value.stamp_ns for each in recording.goals}
    judged = judge_recorded_goals(recording, all_feasible=True)
    fates = [each for each in judged if each.goal.stamp_ns in sent]
    number = {fate: sum(each.result is fate for each in fates) for fate in GoalResult}
    failed = [each for each in fates if each.result in (GoalResult.LOST, GoalResult.STOPPED)]
    executions = [each.execution for each in fates if each.execution]
    verdicts = [each.verdict.code for each in fates if each.verdict]
    reasons = [*verdicts, *(each.reason for each in executions)]
    made = [each.verdict.plan for each in fates if each.verdict and not each.is_continued]
    return {
        "goals": len(fates),
        "applied": number[GoalResult.APPLIED],
        "retried": sum(each.attempts > 1 for each in executions),
        "lost": len(failed),
        "deadline": reasons.count(Verdict.DEADLINE),
        "superseded": number[GoalResult.SUPERSEDED],
        "real_time_factor": compute_real_time_factor(recording),
        **compute_reference_jumps(recording),
        "lead_ms": compute_quantiles(each.lead_ms for each in fates),
        "lead_seen_ms": compute_quantiles(compute_observed_leads(recording, fates)),
        "plan_ms": compute_quantiles(plan.plan_ms for plan in made if plan and plan.plan_stamp_ns),
        "lost_because": [each.explanation for each in failed],
    }


def compute_observed_leads(recording: Recording, judged_goals: Sequence[JudgedGoal]) -> list[float]:
    """Compute the times from goal sent to the instant at which its plan left the old one.

    They come from stamps and trajectories alone, and so check the planner's figure `lead_ms`.

    Args:
        recording: The recording.
        judged_goals: Its judged goals.

    Returns:
        Times in ROS time [ms], one for each goal whose own plan was executed, in the order of the
        goals. Other goals are left out.
    """
    left_ns = find_branch_times(recording)
    return [
        PER_MS * (left_ns[each.plan_stamp_ns] - each.sent.time_ns)
        for each in judged_goals
        if each.plan_stamp_ns in left_ns and not each.is_continued
    ]
