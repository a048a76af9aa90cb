"""What became of each goal that was sent: applied, superseded, refused for its own sake, or lost.

The one definition behind the demo's `goals_lost`, `scripts/bench online` and `scripts/soak`. It
knows only what anybody on the topics can hear.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum

from mhsb_model.goal import Goal
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.verdict import ExecutionReport, GoalVerdict, Outcome, Verdict
from mhsb_sim.recording.recording import Recording, Timed

LEAD_MAX = 1.0
"""Longest time from a goal to the motion that it causes, the planner's `lead_max` [s]; counted by
the system's clock, since that is how long the user waits."""

SETTLING_NS = SECOND_NS
"""Time after a motion's end within which the tip must be at the goal."""

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
"""Codes that find fault with the goal itself: who is told one of these has not lost a goal."""


class Fate(StrEnum):
    """What became of a goal."""

    APPLIED = "applied"  # its plan was in force, and reached it where there was time
    SUPERSEDED = "superseded"  # a newer goal came before its plan could be in force
    REFUSED = "refused"  # there is no way to it
    LOST = "lost"  # anything else


@dataclass(frozen=True)
class GoalFate:
    """One goal.

    sent        when, in ROS time and by the system's clock
    reason      why it was lost, one sentence; empty otherwise
    verdict     None where there was none
    execution   report on how it ended, None where there was none
    plan_stamp_ns  of its plan that came into force; 0 where none was needed, None where none did
    """

    goal: Goal
    sent: Timed
    fate: Fate
    reason: str
    verdict: GoalVerdict | None
    execution: ExecutionReport | None
    plan_stamp_ns: int | None

    @property
    def lead_ms(self) -> float | None:
        """From goal received to where its plan left the old one, retries included [ms].

        None where no plan of its own came into force, or where nobody told.
        """
        plan = self.verdict.plan if self.verdict else None
        if not self.plan_stamp_ns or plan is None or self.continued:
            return None
        told = self.execution.lead_ms if self.execution and self.execution.lead_ms else plan.lead_ms
        return told or None

    @property
    def continued(self) -> bool:
        """Whether the plan in force led there already."""
        return bool(self.verdict and self.verdict.plan and self.verdict.plan.continued)

    @property
    def retried(self) -> bool:
        """Whether more than one plan was sent for it."""
        return self.execution is not None and self.execution.attempts > 1

    @property
    def out_of_time(self) -> bool:
        """Whether it was refused or aborted because no plan could be sent in time."""
        refused = self.verdict is not None and self.verdict.code is Verdict.DEADLINE
        return refused or (
            self.execution is not None and self.execution.reason is Verdict.DEADLINE
        )


def goal_fates(recording: Recording, all_feasible: bool = False) -> tuple[GoalFate, ...]:
    """What became of all goals of a recording that can be read, in the order they were sent.

    all_feasible  there is a way to every goal, whatever its verdict says
    """
    plan_ends = {each.stamp_ns: each.end_ns for each in recording.trajectories}
    until_ns = int(recording.joint_states.time_ns[-1])
    return judged(
        recording.goals,
        recording.reports,
        recording.plans_in_force,
        plan_ends,
        until_ns,
        all_feasible,
    )


def judged(
    goals: Iterable[Timed],
    reports: Iterable[Timed],
    plans_in_force: Iterable[Timed],
    plan_ends: Mapping[int, int],
    until_ns: int,
    all_feasible: bool = False,
) -> tuple[GoalFate, ...]:
    """The same of records as `Recording` has them.

    plan_ends  end of each published trajectory by its stamp, ROS time [ns]
    until_ns   ROS time at which the recording ends
    """
    told = [each.value for each in reports]
    verdicts = {each.goal_stamp_ns: each for each in told if isinstance(each, GoalVerdict)}
    executions = {each.goal_stamp_ns: each for each in told if isinstance(each, ExecutionReport)}
    in_force = {each.value for each in plans_in_force}
    fates: list[GoalFate] = []
    newer: Timed | None = None  # the next goal that there is a way to
    for sent in reversed(list(goals)):
        verdict = verdicts.get(sent.value.stamp_ns)
        execution = executions.get(sent.value.stamp_ns)
        stamp_ns = applied_stamp(verdict, execution, in_force)
        if verdict is not None and verdict.code in OF_THE_GOAL and not all_feasible:
            fate, reason = Fate.REFUSED, ""
        elif stamp_ns is None:
            fate, reason = _never_in_force(sent, verdict, execution, newer)
        else:
            left_until_ns = until_ns if newer is None else newer.time_ns
            fate, reason = _in_time(plan_ends.get(stamp_ns), left_until_ns, execution)
        fates.append(GoalFate(sent.value, sent, fate, reason, verdict, execution, stamp_ns))
        if fate is not Fate.REFUSED:
            newer = sent
    return tuple(reversed(fates))


def applied_stamp(
    verdict: GoalVerdict | None,
    execution: ExecutionReport | None,
    in_force: Container[int],
) -> int | None:
    """Stamp of a goal's plan that came into force; 0 where none was needed, None where none did.

    A plan that the arm refused is made again under the same verdict: the execution's report names
    the last one.
    """
    if verdict is None or verdict.plan is None:
        return None
    if verdict.code is Verdict.AT_GOAL:
        return 0
    last = (execution or verdict.plan).plan_stamp_ns
    return next((s for s in (last, verdict.plan.plan_stamp_ns) if s in in_force), None)


def _never_in_force(
    sent: Timed,
    verdict: GoalVerdict | None,
    execution: ExecutionReport | None,
    newer: Timed | None,
) -> tuple[Fate, str]:
    """What becomes of a goal whose plan never was in force."""
    if verdict is None:
        return Fate.LOST, "it got no verdict"
    if verdict.code not in (Verdict.OK, Verdict.SUPERSEDED):
        return Fate.LOST, f"it was refused with {verdict.code.value}: {verdict.sentence}"
    if newer is None:
        waited = "no newer goal came"
    else:
        wait = (newer.recorded_ns - sent.recorded_ns) / SECOND_NS
        if wait < LEAD_MAX:
            return Fate.SUPERSEDED, ""
        waited = f"the next goal came only {wait:.2f} s later"
    if verdict.code is Verdict.SUPERSEDED:
        return Fate.LOST, f"it was superseded, though {waited}"
    ending = f": {execution.outcome.value}, {execution.sentence}" if execution else ""
    return Fate.LOST, f"it was accepted, but no plan for it came into force, and {waited}{ending}"


def _in_time(
    end_ns: int | None, left_until_ns: int, execution: ExecutionReport | None
) -> tuple[Fate, str]:
    """What becomes of a goal whose plan was in force, and would have ended at `end_ns`."""
    reached = execution is not None and execution.outcome is Outcome.REACHED
    if reached or end_ns is None or left_until_ns < end_ns + SETTLING_NS:
        return Fate.APPLIED, ""
    ending = f"{execution.outcome.value}, {execution.sentence}" if execution else "no report"
    return Fate.LOST, f"it was not reached, though there was time: {ending}"
