"""Judgement of each goal that was sent: applied, superseded, refused, stopped on request, or lost.

This is the only definition behind the demo's `goals_lost`, `scripts/bench online` and
`scripts/soak`. It uses nothing but what is published on the topics.
"""

from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum

from mhsb_model.circuit.dead_time import SETTLING_TIME
from mhsb_model.goal import Goal
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.verdict import ExecutionReport, GoalVerdict, Outcome, Verdict
from mhsb_tools.recording.recording import Recording, TimedValue

LEAD_MAX = 1.0
"""Longest time from a goal to the motion that it causes [s], the planner's parameter `lead_max`.

Machines without pressure sensors have their dead time in addition. It is measured between times of
recording, since this is how long the user waits.
"""

LONGEST_ANSWER_NS = 10 * SECOND_NS
"""Longest time from the stamp of a goal to its verdict for which the stamp counts as a time [ns].

It is that for which `mhsb goal` waits. Stamps are opaque, but usually the time of sending.
"""

OF_THE_GOAL = frozenset(
    {
        Verdict.NOT_FINITE,
        Verdict.FRAME,
        Verdict.OPTIONS,
        Verdict.OUT_OF_WORKSPACE,
        Verdict.INFEASIBLE,
        Verdict.ZONE,
    }
)
"""Verdicts that refuse a goal for its own sake; such a goal does not count as lost."""


class GoalResult(StrEnum):
    """Final judgement of a goal that was sent."""

    APPLIED = "applied"
    """Its plan was in force, and reached the goal if there was time."""

    SUPERSEDED = "superseded"
    """A newer goal came before its plan could be in force."""

    REFUSED = "refused"
    """The planner found fault with the goal itself."""

    STOPPED = "stopped"
    """The user stopped the arm: `~/stop` was called, or a zone was set in motion."""

    LOST = "lost"
    """Everything else."""


@dataclass(frozen=True)
class JudgedGoal:
    """A goal with its final judgement, its verdict and its execution report.

    Attributes:
        goal: The goal.
        sent: The goal with the time at which it was sent, in ROS time and by the recorder's system
            clock.
        result: The final judgement.
        reason: Why it was lost, as one sentence; empty if it was not lost.
        verdict: Its verdict; None if there was none.
        execution: Its execution report; None if there was none.
        plan_stamp_ns: Stamp of its plan that came into force [ns]; 0 if none was needed, None if
            none came into force.
    """

    goal: Goal
    sent: TimedValue
    result: GoalResult
    reason: str
    verdict: GoalVerdict | None
    execution: ExecutionReport | None
    plan_stamp_ns: int | None

    @property
    def fate(self) -> str:
        """Final state of the goal, as one word.

        `superseded`, `refused`, `stopped` and `lost` are results. An applied goal is `at_goal` if
        the arm was there already, `under_way` if no end was reported, otherwise it is the outcome
        of its execution: `reached`, `replaced` or `aborted`.
        """
        if self.result is not GoalResult.APPLIED:
            return self.result.value
        if self.verdict is not None and self.verdict.code is Verdict.AT_GOAL:
            return "at_goal"
        return self.execution.outcome.value if self.execution else "under_way"

    @property
    def explanation(self) -> str:
        """Sentence on the fate: why the goal was lost, or the last report on it."""
        last = self.execution or self.verdict
        return self.reason or (last.sentence if last else "")

    @property
    def lead_ms(self) -> float | None:
        """Time from the goal's receipt until the arm left its old plan for the goal's plan [ms].

        The planner reports it; it includes attempts that the arm refused. None if the time was not
        reported, or if no new plan for the goal came into force. So it is None, too, if the arm was
        there already or kept its old plan.
        """
        plan = self.verdict.plan if self.verdict else None
        if not self.plan_stamp_ns or plan is None or self.is_continued:
            return None
        reported_ms = (
            self.execution.lead_ms if self.execution and self.execution.lead_ms else plan.lead_ms
        )
        return reported_ms or None

    @property
    def is_continued(self) -> bool:
        """True if the plan in force already led to the goal, so that no new one was published."""
        return bool(self.verdict and self.verdict.plan and self.verdict.plan.continued)


def judge_recorded_goals(
    recording: Recording,
    all_feasible: bool = False,
    settling_time: float = SETTLING_TIME,
    lead_max: float = LEAD_MAX,
) -> tuple[JudgedGoal, ...]:
    """Judge each goal of a recording: applied, superseded, refused, stopped or lost.

    A goal whose message was not recorded is judged by its verdict and execution report
    (`find_unrecorded_goals`).

    Args:
        recording: The recording.
        all_feasible: True states that a path to every goal exists. A goal that the planner refused
            then counts as lost, also if the planner found fault with the goal itself.
        settling_time: Time after the end of a motion within which the tip must be at the goal [s].
        lead_max: Longest time from a goal to the motion that it causes [s]. Times of recording are
            compared.

    Returns:
        One judgement for each goal, in the order in which they were sent.
    """
    goals = [*recording.goals, *find_unrecorded_goals(recording)]
    plan_ends = {each.stamp_ns: each.end_ns for each in recording.trajectories}
    until_ns = int(recording.joint_states.time_ns[-1])
    return judge_goals(
        sorted(goals, key=lambda each: each.recorded_ns),
        recording.reports,
        recording.plans_in_force,
        plan_ends,
        until_ns,
        all_feasible,
        settling_time,
        lead_max,
    )


def find_unrecorded_goals(recording: Recording) -> tuple[TimedValue, ...]:
    """Return the goals that got a verdict, but whose messages are not in the recording.

    Such a goal came by the action, or its sender was not yet connected to the recorder, or its
    message is damaged.

    Args:
        recording: The recording.

    Returns:
        The goals, as their verdicts state them, in the order of the verdicts. A goal has the times
        of its verdict, moved back to its stamp if the stamp can be the time of sending. That is
        so if the verdict came 0 to LONGEST_ANSWER_NS after the stamp, by the system clock or, if
        not, in ROS time.
    """
    recorded = {each.value.stamp_ns for each in recording.goals}
    found = []
    for each in recording.reports:
        stamp_ns = each.value.goal_stamp_ns
        if not isinstance(each.value, GoalVerdict) or stamp_ns in recorded:
            continue
        delays = (each.recorded_ns - stamp_ns, each.time_ns - stamp_ns)
        delay_ns = next((delay for delay in delays if 0 <= delay <= LONGEST_ANSWER_NS), 0)
        found.append(
            replace(
                each,
                value=each.value.goal,
                time_ns=each.time_ns - delay_ns,
                recorded_ns=each.recorded_ns - delay_ns,
            )
        )
    return tuple(found)


def judge_goals(
    goals: Iterable[TimedValue],
    reports: Iterable[TimedValue],
    plans_in_force: Iterable[TimedValue],
    plan_ends: Mapping[int, int],
    until_ns: int,
    all_feasible: bool = False,
    settling_time: float = SETTLING_TIME,
    lead_max: float = LEAD_MAX,
) -> tuple[JudgedGoal, ...]:
    """Judge each goal by the reports and plans that followed it.

    The first rule that fits decides:

    1. Refused: the verdict finds fault with the goal itself. The rule is skipped if `all_feasible`.
    2. Stopped: the execution report's outcome is STOPPED or, without a report, the verdict is.
    3. Lost: the goal's plan came into force and ended `settling_time` or more before the next goal
       that was not refused, or before the recording's end. Yet no execution report says that the
       goal was reached.
    4. Applied: the goal's plan came into force, or the arm was at the goal already.
    5. Superseded: the verdict is OK or SUPERSEDED, and a newer goal came within `lead_max`. Newer
       goals that are refused do not count.
    6. Lost: all other goals.

    Args:
        goals: Goals in the order in which they were sent.
        reports: Verdicts and execution reports, in any order.
        plans_in_force: Stamps [ns] of the plans that the arm executed; 0 if it held its position.
        plan_ends: End of each published trajectory [ns, ROS time], by its stamp [ns]. A goal whose
            plan is not in it is never lost by rule 3.
        until_ns: End of the recording [ns, ROS time].
        all_feasible: True states that a path to every goal exists; then no goal is judged as
            refused.
        settling_time: Time after the end of a motion within which the tip must be at the goal [s].
        lead_max: Longest time from a goal to the motion that it causes [s]. Times of recording are
            compared.

    Returns:
        One judgement for each goal, in the order of `goals`.
    """
    values = [each.value for each in reports]
    verdicts = {each.goal_stamp_ns: each for each in values if isinstance(each, GoalVerdict)}
    executions = {each.goal_stamp_ns: each for each in values if isinstance(each, ExecutionReport)}
    in_force = {each.value for each in plans_in_force}
    fates: list[JudgedGoal] = []
    newer: TimedValue | None = None  # the next goal that was not refused
    for sent in reversed(list(goals)):
        verdict = verdicts.get(sent.value.stamp_ns)
        execution = executions.get(sent.value.stamp_ns)
        stamp_ns = find_applied_stamp(verdict, execution, in_force)
        if verdict is not None and verdict.code in OF_THE_GOAL and not all_feasible:
            fate, reason = GoalResult.REFUSED, ""
        elif _was_stopped(verdict, execution):
            fate, reason = GoalResult.STOPPED, ""
        elif stamp_ns is None:
            fate, reason = _judge_unapplied_goal(sent, verdict, execution, newer, lead_max)
        else:
            left_until_ns = until_ns if newer is None else newer.time_ns
            left_until_ns -= round(settling_time * SECOND_NS)
            fate, reason = _judge_applied_goal(plan_ends.get(stamp_ns), left_until_ns, execution)
        fates.append(JudgedGoal(sent.value, sent, fate, reason, verdict, execution, stamp_ns))
        if fate is not GoalResult.REFUSED:
            newer = sent
    return tuple(reversed(fates))


def find_applied_stamp(
    verdict: GoalVerdict | None,
    execution: ExecutionReport | None,
    in_force: Container[int],
) -> int | None:
    """Return the stamp of the goal's plan that the arm executed.

    If the arm refuses a plan, the planner makes another one under the same verdict. The verdict has
    the stamp of the first plan, the execution report the stamp of the last plan. If the arm
    executed both, the last plan counts.

    Args:
        verdict: Verdict on the goal; None if there was none.
        execution: Execution report of the goal; None if there was none.
        in_force: Stamps of all plans that the arm executed [ns].

    Returns:
        The stamp [ns]; 0 if no plan was needed because the arm was at the goal. None if the arm
        executed no plan for this goal, or if there is no verdict with a plan.
    """
    if verdict is None or verdict.plan is None:
        return None
    if verdict.code is Verdict.AT_GOAL:
        return 0
    last = (execution or verdict.plan).plan_stamp_ns
    return next((s for s in (last, verdict.plan.plan_stamp_ns) if s in in_force), None)


def _was_stopped(verdict: GoalVerdict | None, execution: ExecutionReport | None) -> bool:
    """Return whether a goal ended because the user stopped the arm, before or after a plan.

    Args:
        verdict: Verdict on the goal. It only counts if `execution` is None.
        execution: Execution report of the goal; None if the goal was not accepted or the report is
            missing.

    Returns:
        True if the report's outcome is STOPPED. Without a report, true if the verdict's code is
        STOPPED. False if both are None.
    """
    if execution is not None:
        return execution.outcome is Outcome.STOPPED
    return verdict is not None and verdict.code is Verdict.STOPPED


def _judge_unapplied_goal(
    sent: TimedValue,
    verdict: GoalVerdict | None,
    execution: ExecutionReport | None,
    newer: TimedValue | None,
    lead_max: float,
) -> tuple[GoalResult, str]:
    """Judge a goal for which no plan came into force.

    It is superseded if its verdict is OK or SUPERSEDED and a newer goal was recorded less than
    `lead_max` later. Otherwise it is lost.

    Args:
        sent: The goal with its times. It was not refused for its own sake. Only `recorded_ns` is
            read.
        verdict: Its verdict; None if there was none.
        execution: Its execution report; None if there was none.
        newer: The next goal that was not refused for its own sake; None if there is none.
        lead_max: Longest time from a goal to the motion that it causes [s].

    Returns:
        `GoalResult.SUPERSEDED` and an empty text, or `GoalResult.LOST` and the reason.
    """
    if verdict is None:
        return GoalResult.LOST, "it got no verdict"
    if verdict.code not in (Verdict.OK, Verdict.SUPERSEDED):
        return GoalResult.LOST, f"it was refused with {verdict.code.value}: {verdict.sentence}"
    if newer is None:
        waited = "no newer goal came"
    else:
        wait = (newer.recorded_ns - sent.recorded_ns) / SECOND_NS
        if wait < lead_max:
            return GoalResult.SUPERSEDED, ""
        waited = f"the next goal came only {wait:.2f} s later"
    if verdict.code is Verdict.SUPERSEDED:
        return GoalResult.LOST, f"it was superseded, though {waited}"
    ending = f": {execution.outcome.value}, {execution.sentence}" if execution else ""
    return (
        GoalResult.LOST,
        f"it was accepted, but no plan for it came into force, and {waited}{ending}",
    )


def _judge_applied_goal(
    end_ns: int | None, left_until_ns: int, execution: ExecutionReport | None
) -> tuple[GoalResult, str]:
    """Judge a goal whose plan came into force, or that needed no plan.

    The goal is lost if its plan ended at or before `left_until_ns` and no execution report says
    that the goal was reached. Otherwise it is applied, also if `end_ns` is
    None.

    Args:
        end_ns: End of the goal's plan [ns, ROS time]; None if there was no plan, or its trajectory
            was not recorded.
        left_until_ns: Latest end of a plan that leaves time to settle at the goal [ns, ROS time].
            It is the time of the next goal that was not refused, or the end of the recording, minus
            the settling time.
        execution: Execution report of the goal; None if there was none.

    Returns:
        `GoalResult.LOST` and the reason, or `GoalResult.APPLIED` and an empty text.
    """
    reached = execution is not None and execution.outcome is Outcome.REACHED
    if reached or end_ns is None or left_until_ns < end_ns:
        return GoalResult.APPLIED, ""
    ending = f"{execution.outcome.value}, {execution.sentence}" if execution else "no report"
    return GoalResult.LOST, f"it was not reached, though there was time: {ending}"
