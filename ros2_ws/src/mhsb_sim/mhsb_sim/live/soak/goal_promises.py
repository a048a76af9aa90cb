"""Promises about goals and plans: each gets its answers, once, and none is lost."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

from mhsb_model.trajectory import SECOND_NS
from mhsb_model.verdict import ExecutionReport, GoalVerdict, Verdict
from mhsb_sim.live.soak.events import PLANNER, SIM, DeedKind, Events, overlapping
from mhsb_sim.live.soak.kept import Kept
from mhsb_sim.recording.recording import Timed
from mhsb_sim.report.goal_fates import OF_THE_GOAL, Fate, goal_fates

ANSWER_NS = 5 * SECOND_NS
"""A node that lives for so long after a message has heard it, and may be asked for the answer."""

DISTURBING = tuple(set(DeedKind) - {DeedKind.GOAL, DeedKind.PARAMETER})
"""What may keep a goal from being reached."""

SETTLED = 4.0
"""Time after a disturbance in which it may still be felt, finding each other included [s]."""

LONGEST_MOTION_NS = 60 * SECOND_NS

NOTICED_NS = SECOND_NS // 2
"""Time for the planner to hear of a fault."""


def one_verdict(events: Events) -> Kept:
    """Every goal that a living planner receives gets exactly one verdict; no goal gets two."""
    given = Counter(report.value.goal_stamp_ns for report in _verdicts(events))
    broken, tested = [], 0
    for goal in events.deeds_of(DeedKind.GOAL):
        heard = events.alive(PLANNER, goal.begin_ns, goal.begin_ns + ANSWER_NS)
        tested += heard
        if given[goal.value] > 1 or (heard and given[goal.value] == 0):
            when = events.seconds(goal.begin_ns)
            broken.append(f"the goal sent at {when:.2f} s got {given[goal.value]} verdicts")
    return Kept(tested, tuple(broken))


def one_ending(events: Events) -> Kept:
    """Every goal with a plan gets exactly one report on how its execution ended."""
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
    return Kept(tested, tuple(broken))


def none_lost(events: Events) -> Kept:
    """No goal is lost, unless something was done that may keep it from being reached."""
    disturbances = events.deeds_of(*DISTURBING)
    sent = sorted(goal.begin_ns for goal in events.deeds_of(DeedKind.GOAL))
    ended = {
        each.value.goal_stamp_ns: each.recorded_ns
        for each in events.recording.reports
        if isinstance(each.value, ExecutionReport)
    }
    broken, tested = [], 0
    for fate in goal_fates(events.recording):
        begin_ns = fate.sent.recorded_ns
        later = (time_ns for time_ns in sent if time_ns > begin_ns + SECOND_NS)
        end_ns = ended.get(fate.goal.stamp_ns, next(later, events.end_ns))
        end_ns = min(end_ns, begin_ns + LONGEST_MOTION_NS)
        disturbed = overlapping(disturbances, begin_ns, end_ns, after=SETTLED)
        if disturbed or _faulty(events, begin_ns) or _something_fails(events, begin_ns, end_ns):
            continue
        tested += 1
        if fate.fate is Fate.LOST:
            broken.append(f"the goal sent at {events.seconds(begin_ns):.2f} s: {fate.reason}")
    return Kept(tested, tuple(broken))


def told_once(events: Events) -> Kept:
    """The arm tells of every plan that it receives exactly once what became of it."""
    told = Counter(each.value.plan_stamp_ns for each in events.recording.hand_overs)
    resets = events.deeds_of(DeedKind.RESET, DeedKind.FAULT, DeedKind.HEAL)
    broken, tested = [], 0
    for stamp_ns in {each.stamp_ns for each in events.recording.trajectories}:
        sent_ns = events.system_ns(stamp_ns)
        answer_ns = sent_ns + ANSWER_NS
        found_ns = sent_ns - round(SETTLED * SECOND_NS)
        heard = all(events.alive(node, found_ns, answer_ns) for node in (PLANNER, SIM))
        heard = heard and not overlapping(resets, sent_ns, answer_ns, before=0.5)
        tested += heard
        if told[stamp_ns] > 1 or (heard and told[stamp_ns] == 0):
            when = events.seconds(stamp_ns)
            broken.append(f"of the plan stamped {when:.3f} s it told {told[stamp_ns]} times")
    return Kept(tested, tuple(broken))


def stamps_increase(events: Events) -> Kept:
    """The stamps of a planner's plans increase."""
    stamps = [each.stamp_ns for each in events.recording.trajectories]
    broken = tuple(
        f"{events.seconds(after):.3f} s comes after {events.seconds(before):.3f} s"
        for before, after in pairwise(stamps)
        if after <= before
    )
    return Kept(len(stamps), broken)


def refused_at_faults(events: Events) -> Kept:
    """While the arm reports a fault, no goal is accepted, and the code says so."""
    sent = {goal.value: goal.begin_ns for goal in events.deeds_of(DeedKind.GOAL)}
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
    return Kept(tested, tuple(broken))


def _verdicts(events: Events) -> list[Timed]:
    return [each for each in events.recording.reports if isinstance(each.value, GoalVerdict)]


def _faulty(events: Events, time_ns: int) -> bool:
    """Whether the arm reports a fault around a time."""
    return any(
        begin_ns - SETTLED * SECOND_NS < time_ns < end_ns + SETTLED * SECOND_NS
        for begin_ns, end_ns in _reported_faults(events)
    )


def _something_fails(events: Events, begin_ns: int, end_ns: int) -> bool:
    """Whether something fails between these times that may not be found, as a stuck valve."""
    heals = events.deeds_of(DeedKind.HEAL, DeedKind.RESET)
    for fault in events.deeds_of(DeedKind.FAULT):
        later = (heal.end_ns for heal in heals if heal.begin_ns >= fault.begin_ns)
        if fault.begin_ns < end_ns and begin_ns < next(later, events.end_ns):
            return True
    return False


def _reported_faults(events: Events) -> list[tuple[int, int]]:
    """Times [ns] from the first report of a fault to the first without."""
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
