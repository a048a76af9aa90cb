"""What became of goals, from records of what was sent and heard."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mhsb_model.goal import Goal
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.verdict import ExecutionReport, GoalVerdict, Outcome, PlanSummary, Verdict
from mhsb_tools.recording.recording import TimedValue
from mhsb_tools.report.goal_fates import (
    GoalResult,
    find_unrecorded_goals,
    judge_goals,
    judge_recorded_goals,
)

WALL_NS = 1_700_000_000 * SECOND_NS


def at(time: float, value: object, speed: float = 1.0) -> TimedValue:
    """A record at a time of the system's clock [s], simulated time running at `speed`."""
    return TimedValue(round(speed * time * SECOND_NS), value, WALL_NS + round(time * SECOND_NS))


def goal(number: int) -> Goal:
    return Goal(number, 0.5, 0.1)


def plan_of(stamp_ns: int, continued: bool = False) -> PlanSummary:
    return PlanSummary(stamp_ns, 100.0, 90.0, 4.0, 2, 40.0, 50.0, 60.0, continued)


def verdict(number: int, code: Verdict, plan: PlanSummary | None = None) -> GoalVerdict:
    return GoalVerdict(code, "a sentence", goal(number), plan)


def ended(number: int, outcome: Outcome, stamp_ns: int, **more: object) -> ExecutionReport:
    return ExecutionReport(outcome, "a sentence", number, stamp_ns, **more)


def fates(*, goals=(0.0,), reports=(), in_force=(), ends=(), until=20.0, speed=1.0, **more):
    """Fates of goals 1, 2, … sent at these times, of plans `ends` = ((stamp, end [s]),
    …).
    """
    return judge_goals(
        [at(time, goal(number), speed) for number, time in enumerate(goals, 1)],
        [at(0.0, report) for report in reports],
        [at(0.0, stamp) for stamp in in_force],
        {stamp: round(end * SECOND_NS) for stamp, end in ends},
        round(until * SECOND_NS),
        **more,
    )


def test_a_goal_whose_plan_was_in_force_and_was_reached_is_applied():
    [fate] = fates(
        reports=[
            verdict(1, Verdict.OK, plan_of(77)),
            ended(1, Outcome.REACHED, 77, lead_ms=60.0),
        ],
        in_force=[0, 77, 0],
        ends=[(77, 5.0)],
    )
    assert (fate.result, fate.reason, fate.plan_stamp_ns) == (GoalResult.APPLIED, "", 77)
    assert fate.lead_ms == 60.0


def test_without_a_verdict_a_goal_is_lost():
    [fate] = fates()
    assert (fate.result, fate.reason) == (GoalResult.LOST, "it got no verdict")


@pytest.mark.parametrize("code", [Verdict.DEADLINE, Verdict.NO_STATE, Verdict.INTERNAL])
def test_a_goal_refused_for_what_is_not_its_own_fault_is_lost(code):
    [fate] = fates(reports=[verdict(1, code)])
    assert fate.result is GoalResult.LOST
    assert f"refused with {code}" in fate.reason


def test_a_goal_that_nothing_leads_to_is_refused_and_supersedes_nothing():
    first, second = fates(
        goals=(0.0, 0.5),
        reports=[verdict(1, Verdict.SUPERSEDED), verdict(2, Verdict.OUT_OF_WORKSPACE)],
    )
    assert second.result is GoalResult.REFUSED
    assert first.result is GoalResult.LOST
    assert "no newer goal came" in first.reason


def test_a_goal_that_is_known_to_be_feasible_may_not_be_called_infeasible():
    [fate] = fates(reports=[verdict(1, Verdict.INFEASIBLE)], all_feasible=True)
    assert fate.result is GoalResult.LOST


@pytest.mark.parametrize(
    "report", [verdict(1, Verdict.SUPERSEDED), verdict(1, Verdict.OK, plan_of(77))]
)
def test_a_newer_goal_supersedes_one_only_until_the_longest_lead_is_over(report):
    done = [verdict(2, Verdict.OK, plan_of(88)), ended(2, Outcome.REACHED, 88)]
    for wait, expected in ((0.9, GoalResult.SUPERSEDED), (1.1, GoalResult.LOST)):
        first, second = fates(goals=(0.0, wait), reports=[report, *done], in_force=[0, 88])
        assert first.result is expected
        assert second.result is GoalResult.APPLIED
        assert first.lead_ms is None


def test_a_dead_time_lengthens_the_longest_lead():
    reports = [verdict(1, Verdict.SUPERSEDED), verdict(2, Verdict.AT_GOAL, plan_of(0))]
    for wait, expected in ((1.2, GoalResult.SUPERSEDED), (1.3, GoalResult.LOST)):
        assert fates(goals=(0.0, wait), reports=reports, lead_max=1.25)[0].result is expected


def test_the_longest_lead_is_counted_as_the_user_waits_however_fast_time_is_simulated():
    reports = [verdict(1, Verdict.SUPERSEDED), verdict(2, Verdict.AT_GOAL, plan_of(0))]
    for speed in (0.3, 5.0):
        assert (
            fates(goals=(0.0, 0.9), reports=reports, speed=speed)[0].result is GoalResult.SUPERSEDED
        )
        assert fates(goals=(0.0, 1.1), reports=reports, speed=speed)[0].result is GoalResult.LOST


def test_an_accepted_goal_whose_plan_the_arm_never_took_is_lost_and_says_how_it_ended():
    [fate] = fates(
        reports=[
            verdict(1, Verdict.OK, plan_of(77)),
            ended(1, Outcome.ABORTED, 79, attempts=3, reason=Verdict.DEADLINE),
        ],
        in_force=[0],
    )
    assert fate.result is GoalResult.LOST
    assert "no plan for it came into force, and no newer goal came: aborted" in fate.reason


def test_a_goal_planned_again_is_applied_by_its_last_plan_and_its_lead_is_that_ones():
    [fate] = fates(
        reports=[
            verdict(1, Verdict.OK, plan_of(77)),
            ended(1, Outcome.REACHED, 78, attempts=2, lead_ms=150.0),
        ],
        in_force=[0, 78],
        ends=[(77, 5.0), (78, 5.1)],
    )
    assert (fate.result, fate.plan_stamp_ns, fate.lead_ms) == (GoalResult.APPLIED, 78, 150.0)


def test_a_goal_with_time_for_its_whole_motion_must_be_reached():
    reports = [
        verdict(1, Verdict.OK, plan_of(77)),
        ended(1, Outcome.ABORTED, 77),
        verdict(2, Verdict.AT_GOAL, plan_of(0)),
    ]
    for wait, expected in ((5.9, GoalResult.APPLIED), (6.1, GoalResult.LOST)):
        first, _ = fates(goals=(0.0, wait), reports=reports, in_force=[77], ends=[(77, 5.0)])
        assert first.result is expected
    assert "not reached, though there was time: aborted" in first.reason
    [last] = fates(reports=reports[:2], in_force=[77], ends=[(77, 5.0)], until=5.5)
    assert last.result is GoalResult.APPLIED


@pytest.mark.parametrize("in_force", [[], [77]])
def test_a_goal_that_the_user_stopped_is_not_lost(in_force):
    [fate] = fates(
        reports=[verdict(1, Verdict.OK, plan_of(77)), ended(1, Outcome.STOPPED, 77)],
        in_force=in_force,
        ends=[(77, 5.0)],
    )
    assert (fate.result, fate.reason, fate.fate) == (GoalResult.STOPPED, "", "stopped")
    [before_a_plan] = fates(reports=[verdict(1, Verdict.STOPPED)])
    assert before_a_plan.result is GoalResult.STOPPED


def test_each_goal_has_one_fate():
    first, second, third, fourth, fifth = fates(
        goals=(0.0, 7.0, 7.5, 9.0, 20.0),
        reports=[
            verdict(1, Verdict.OK, plan_of(77)),
            ended(1, Outcome.REPLACED, 77),
            verdict(2, Verdict.OK, plan_of(88)),
            ended(2, Outcome.REPLACED, 88),
            verdict(3, Verdict.OK, plan_of(99)),
            ended(3, Outcome.ABORTED, 99),
            verdict(4, Verdict.AT_GOAL, plan_of(0)),
            verdict(5, Verdict.OK, plan_of(110)),
        ],
        in_force=[77, 99, 110],
        ends=[(77, 5.0), (99, 12.0), (110, 25.0)],
    )
    assert first.fate == "lost"
    assert first.explanation == "it was not reached, though there was time: replaced, a sentence"
    assert second.fate == "superseded"
    assert (third.fate, third.explanation) == ("aborted", "a sentence")
    assert [fourth.fate, fifth.fate] == ["at_goal", "under_way"]


def test_the_time_for_a_motion_is_simulated_time():
    reports = [verdict(1, Verdict.OK, plan_of(77)), verdict(2, Verdict.AT_GOAL, plan_of(0))]
    slow, _ = fates(goals=(0.0, 8.0), reports=reports, in_force=[77], ends=[(77, 5.0)], speed=0.5)
    assert slow.result is GoalResult.APPLIED


def test_a_goal_that_needs_nothing_or_is_on_its_way_already_is_applied_without_a_lead():
    first, second, third = fates(
        goals=(0.0, 2.0, 4.0),
        reports=[
            verdict(1, Verdict.OK, plan_of(77)),
            verdict(2, Verdict.OK, plan_of(77, continued=True)),
            verdict(3, Verdict.AT_GOAL, plan_of(0)),
            ended(2, Outcome.REACHED, 77),
        ],
        in_force=[77],
        ends=[(77, 3.0)],
    )
    assert [each.result for each in (first, second, third)] == [GoalResult.APPLIED] * 3
    assert [each.lead_ms for each in (first, second, third)] == [60.0, None, None]


def test_a_recording_tells_the_fates_of_its_goals(run):
    told = {each.goal.stamp_ns: each for each in judge_recorded_goals(run.recording)}
    expected = [
        GoalResult.APPLIED,
        GoalResult.APPLIED,
        GoalResult.REFUSED,
        GoalResult.REFUSED,
        GoalResult.APPLIED,
        GoalResult.APPLIED,
    ]
    assert [each.result for each in told.values()] == expected


def test_goals_whose_messages_were_not_recorded_have_the_same_fates(run):
    expected = judge_recorded_goals(run.recording)
    for heard in ((), run.recording.goals[::2]):
        fates = judge_recorded_goals(replace(run.recording, goals=heard))
        assert [each.fate for each in fates] == [each.fate for each in expected]
        assert [each.goal.stamp_ns for each in fates] == [each.goal.stamp_ns for each in expected]


@pytest.mark.parametrize("clock", ["recorded_ns", "time_ns"])
def test_a_goal_that_was_not_recorded_was_sent_at_its_stamp_if_that_is_a_time(run, clock):
    report = at(50.0, None)
    stamp_ns = getattr(report, clock) - 2 * SECOND_NS
    reports = [
        replace(report, value=verdict(stamp_ns, Verdict.SUPERSEDED)),
        replace(report, value=verdict(7, Verdict.SUPERSEDED)),
    ]
    timed, untimed = find_unrecorded_goals(replace(run.recording, goals=(), reports=tuple(reports)))
    assert (timed.time_ns, timed.recorded_ns) == (
        at(48.0, None).time_ns,
        at(48.0, None).recorded_ns,
    )
    assert (untimed.time_ns, untimed.recorded_ns) == (report.time_ns, report.recorded_ns)
