"""What became of goals, where the recording is not complete."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mhsb_model.verdict import ExecutionReport
from mhsb_tools.report.recorded_goals import evaluate_goals, find_take_over_times


def records(run, **changes):
    return evaluate_goals(replace(run.recording, **changes), run.reference, run.tip)


def test_plans_take_over_in_the_order_of_their_times(run):
    since = [
        (time - run.reference.stamp_ns) / 1e9
        for time in find_take_over_times(run.recording).values()
    ]
    assert since == pytest.approx([1.0, 3.0, 6.0], abs=1e-6)


def test_a_plan_that_never_took_over_was_not_in_motion_and_has_no_rest(run):
    goals = records(run, plans_in_force=run.recording.plans_in_force[:1])
    assert len(goals) == 6
    assert all(goal.taken_over_ns is None for goal in goals)
    assert not any(goal.in_motion for goal in goals)
    assert all(goal.distance_at_rest is None for goal in goals)


def test_a_goal_that_was_planned_again_is_taken_over_by_the_plan_that_was_applied(run):
    later = run.goals[1].verdict.plan.plan_stamp_ns

    def told(report):
        first = report.goal_stamp_ns == run.goals[0].verdict.goal_stamp_ns
        again = first and isinstance(report, ExecutionReport)
        return replace(report, plan_stamp_ns=later) if again else report

    reports = tuple(replace(each, value=told(each.value)) for each in run.recording.reports)
    goal = records(run, reports=reports)[0]
    assert goal.taken_over_ns == run.goals[1].taken_over_ns
    assert goal.in_motion


def test_a_rest_too_short_for_its_window_counts_from_the_arrival(run):
    # The next plan takes over 0.1 s after the arrival: the swing before it must not count.
    later = run.recording.plans_in_force
    early = [
        replace(each, time_ns=run.reference.stamp_ns + 5_100_000_000)
        if each.time_ns - run.reference.stamp_ns > 5.9e9 and each.value != 0
        else each
        for each in later
    ]
    goal = records(run, plans_in_force=tuple(early))[1]
    assert goal.distance_at_rest == pytest.approx(2e-3)


def test_a_goal_is_at_rest_even_where_its_trajectory_was_not_recorded(run):
    assert records(run, trajectories=())[1].distance_at_rest == pytest.approx(2e-3)
