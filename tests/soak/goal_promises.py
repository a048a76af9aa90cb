"""Promises about goals and plans: each gets its answers exactly once, and none is lost."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

import numpy as np
from tests.soak.events import PLANNER, SIM, ActionKind, Events, overlaps_any
from tests.soak.kept import PromiseResult

from mhsb_model.errors import MhsbError
from mhsb_model.trajectory import SECOND_NS, MotionState
from mhsb_model.verdict import ExecutionReport, GoalVerdict, Verdict
from mhsb_planner.errors import NoPathError
from mhsb_planner.planner import Planner
from mhsb_planner.posture.posture_table_cache import load_or_build_table
from mhsb_tools.recording.recording import TimedValue
from mhsb_tools.report.goal_fates import OF_THE_GOAL, GoalResult, JudgedGoal, judge_recorded_goals

ANSWER_NS = 5 * SECOND_NS
"""A node that lives for this time after a message has received it, and must answer [ns]."""

DISTURBING = tuple(set(ActionKind) - {ActionKind.GOAL, ActionKind.PARAMETER})
"""Kinds of actions that may keep a goal from being reached."""

SETTLED = 4.0
"""Time after a disturbance in which it may still have effects, including discovery of nodes [s]."""

LONGEST_MOTION_NS = 60 * SECOND_NS
"""Largest time from a goal to the end of its execution [ns]."""

NOTICED_NS = SECOND_NS // 2
"""Time for the planner to learn of a fault [ns]."""


def check_one_verdict(events: Events) -> PromiseResult:
    """Check that every goal that a living planner receives gets exactly one verdict.

    A planner counts as living if one process ran for 5 s after the goal was sent, without being
    frozen. No goal may get two verdicts, whether the planner lived or not.

    Args:
        events: Everything recorded in the soak.

    Returns:
        The result; each goal that a living planner received is one case.
    """
    given = Counter(report.value.goal_stamp_ns for report in _verdicts(events))
    broken, tested = [], 0
    for goal in events.actions_of(ActionKind.GOAL):
        heard = events.alive(PLANNER, goal.begin_ns, goal.begin_ns + ANSWER_NS)
        tested += heard
        if given[goal.value] > 1 or (heard and given[goal.value] == 0):
            when = events.seconds(goal.begin_ns)
            broken.append(f"the goal sent at {when:.2f} s got {given[goal.value]} verdicts")
    return PromiseResult(tested, tuple(broken))


def check_one_execution_report(events: Events) -> PromiseResult:
    """Check that every accepted goal gets exactly one execution report.

    A report may be missing if the planner's process ended before the soak did.

    Args:
        events: Everything recorded in the soak.

    Returns:
        The result; each accepted goal whose planner lived on is one case.
    """
    reports = [each.value for each in events.recording.reports]
    endings = Counter(each.goal_stamp_ns for each in reports if isinstance(each, ExecutionReport))
    broken, tested = [], 0
    for report in _verdicts(events):
        verdict = report.value
        count = endings[verdict.goal_stamp_ns]
        planner = [
            life
            for life in events.lives_of(PLANNER)
            if life.ready_ns <= report.recorded_ns <= life.end_ns
        ]
        lived_on = bool(planner) and planner[-1].end_ns >= events.end_ns
        expected = verdict.code is Verdict.OK and lived_on
        tested += expected
        if count > 1 or (expected and count == 0):
            when = events.seconds(report.recorded_ns)
            broken.append(
                f"the goal that was answered {verdict.code.value} at {when:.2f} s got {count} ends"
            )
    return PromiseResult(tested, tuple(broken))


def check_no_goal_lost(events: Events) -> PromiseResult:
    """Check that no goal is lost unless something disturbed it.

    A goal is left out if a disturbing action or an injected fault overlaps its execution. It is
    also left out if the arm reports a fault around the time of sending. Disturbances count until
    `SETTLED` after their end. A goal that was not found in time is left out if no path leads to it.

    Args:
        events: Everything recorded in the soak.

    Returns:
        The result; each undisturbed goal is one case.
    """
    disturbances = events.actions_of(*DISTURBING)
    sent = sorted(goal.begin_ns for goal in events.actions_of(ActionKind.GOAL))
    ended = {
        each.value.goal_stamp_ns: each.recorded_ns
        for each in events.recording.reports
        if isinstance(each.value, ExecutionReport)
    }
    broken, tested = [], 0
    for fate in judge_recorded_goals(events.recording):
        begin_ns = fate.sent.recorded_ns
        later = (time_ns for time_ns in sent if time_ns > begin_ns + SECOND_NS)
        end_ns = ended.get(fate.goal.stamp_ns, next(later, events.end_ns))
        end_ns = min(end_ns, begin_ns + LONGEST_MOTION_NS)
        disturbed = overlaps_any(disturbances, begin_ns, end_ns, after=SETTLED)
        if (
            disturbed
            or _reports_fault_near(events, begin_ns)
            or _has_active_fault(events, begin_ns, end_ns)
        ):
            continue
        lost = fate.result in (GoalResult.LOST, GoalResult.STOPPED)
        if lost and _has_no_path(events, fate):
            continue
        tested += 1
        if lost:
            broken.append(f"the goal sent at {events.seconds(begin_ns):.2f} s: {fate.explanation}")
    return PromiseResult(tested, tuple(broken))


def check_one_hand_over_report(events: Events) -> PromiseResult:
    """Check that the arm reports exactly once on the hand-over of every plan that it receives.

    Args:
        events: Everything recorded in the soak.

    Returns:
        The result; each plan sent while both nodes lived, without a reset or fault, is one case.
    """
    told = Counter(each.value.plan_stamp_ns for each in events.recording.hand_overs)
    resets = events.actions_of(ActionKind.RESET, ActionKind.FAULT, ActionKind.HEAL)
    broken, tested = [], 0
    for stamp_ns in {each.stamp_ns for each in events.recording.trajectories}:
        sent_ns = events.system_ns(stamp_ns)
        answer_ns = sent_ns + ANSWER_NS
        found_ns = sent_ns - round(SETTLED * SECOND_NS)
        heard = all(events.alive(node, found_ns, answer_ns) for node in (PLANNER, SIM))
        heard = heard and not overlaps_any(resets, sent_ns, answer_ns, before=0.5)
        tested += heard
        if told[stamp_ns] > 1 or (heard and told[stamp_ns] == 0):
            when = events.seconds(stamp_ns)
            broken.append(f"of the plan stamped {when:.3f} s it told {told[stamp_ns]} times")
    return PromiseResult(tested, tuple(broken))


def check_stamps_increase(events: Events) -> PromiseResult:
    """Check that the stamps of published plans increase from each plan to the next.

    Args:
        events: Everything recorded in the soak.

    Returns:
        The result; each plan is one case.
    """
    stamps = [each.stamp_ns for each in events.recording.trajectories]
    broken = tuple(
        f"{events.seconds(after):.3f} s comes after {events.seconds(before):.3f} s"
        for before, after in pairwise(stamps)
        if after <= before
    )
    return PromiseResult(len(stamps), broken)


def check_refused_at_faults(events: Events) -> PromiseResult:
    """Check that no goal is accepted while the arm reports a fault.

    The verdict must be FAULT, SUPERSEDED, or one that concerns the goal itself. Goals sent within
    0.5 s of the first report do not count, nor do verdicts after the fault has ended.

    Args:
        events: Everything recorded in the soak.

    Returns:
        The result; each goal sent while a fault was reported is one case.
    """
    sent = {goal.value: goal.begin_ns for goal in events.actions_of(ActionKind.GOAL)}
    allowed = {*OF_THE_GOAL, Verdict.FAULT, Verdict.SUPERSEDED}
    broken, tested = [], 0
    for report in _verdicts(events):
        verdict = report.value
        sent_ns = sent.get(verdict.goal_stamp_ns, 0)
        reported = [
            (begin_ns, end_ns)
            for begin_ns, end_ns in _reported_faults(events)
            if begin_ns + NOTICED_NS < sent_ns and report.recorded_ns < end_ns
        ]
        tested += bool(reported)
        if reported and verdict.code not in allowed:
            when = events.seconds(sent_ns)
            broken.append(f"the goal sent at {when:.2f} s got {verdict.code.value}")
    return PromiseResult(tested, tuple(broken))


def _has_no_path(events: Events, fate: JudgedGoal) -> bool:
    """Return whether a goal was refused as NOT_FOUND, and planning proves that it has no path.

    It is planned again without a deadline, from rest at the reference when it was sent, with the
    zones that were set by then. The proof can take longer than the longest commit horizon.

    Args:
        events: Everything recorded in the soak.
        fate: The goal.
    """
    if fate.verdict is None or fate.verdict.code is not Verdict.NOT_FOUND:
        return False
    zones = events.machine.zones  # those of its file, which a planner has when it starts
    for action in events.actions_of(ActionKind.ZONES, ActionKind.START):
        if action.begin_ns < fate.sent.recorded_ns and action.done and action.node == PLANNER:
            is_set = action.kind is ActionKind.ZONES
            zones = action.value if is_set else events.machine.zones
    machine, references = events.machine.changed(zones=zones), events.recording.references
    row = int(np.searchsorted(references.recorded_ns, fate.sent.recorded_ns, "right")) - 1
    start = MotionState.at_rest(references.position[max(row, 0)])
    try:
        Planner(machine, load_or_build_table(machine)).plan(fate.goal.position, start)
    except NoPathError:
        return True
    except MhsbError:
        return False
    return False


def _verdicts(events: Events) -> list[TimedValue]:
    """Return the recorded verdicts, in order of time."""
    return [each for each in events.recording.reports if isinstance(each.value, GoalVerdict)]


def _reports_fault_near(events: Events, time_ns: int) -> bool:
    """Return whether the arm reports a fault within `SETTLED` of a time.

    Args:
        events: Everything recorded in the soak.
        time_ns: System time [ns].
    """
    return any(
        begin_ns - SETTLED * SECOND_NS < time_ns < end_ns + SETTLED * SECOND_NS
        for begin_ns, end_ns in _reported_faults(events)
    )


def _has_active_fault(events: Events, begin_ns: int, end_ns: int) -> bool:
    """Return whether an injected fault is active between two times.

    Such a fault, for example a stuck valve, may stay undetected.

    Args:
        events: Everything recorded in the soak.
        begin_ns: Beginning of the span, system time [ns].
        end_ns: End of the span [ns].

    Returns:
        True if a fault was injected and not yet healed at some time of the span.
    """
    heals = events.actions_of(ActionKind.HEAL, ActionKind.RESET)
    for fault in events.actions_of(ActionKind.FAULT):
        later = (heal.end_ns for heal in heals if heal.begin_ns >= fault.begin_ns)
        if fault.begin_ns < end_ns and begin_ns < next(later, events.end_ns):
            return True
    return False


def _reported_faults(events: Events) -> list[tuple[int, int]]:
    """Return the spans of time in which the arm reports a fault.

    Args:
        events: Everything recorded in the soak.

    Returns:
        Pairs of the first report with a fault and the next one without, or the soak's end [ns].
    """
    spans: list[tuple[int, int]] = []
    since_ns: int | None = None
    for each in events.recording.simulator_reports:
        if each.value.faulty and since_ns is None:
            since_ns = each.recorded_ns
        elif not each.value.faulty and since_ns is not None:
            spans.append((since_ns, each.recorded_ns))
            since_ns = None
    if since_ns is not None:
        spans.append((since_ns, events.end_ns))
    return spans
