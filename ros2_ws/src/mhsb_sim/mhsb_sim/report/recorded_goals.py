"""What became of each goal in a recording, from its verdict to the tip's rest at it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_model.verdict import ExecutionReport, GoalVerdict, Outcome
from mhsb_sim.recording.recording import Recording
from mhsb_sim.report.goal_fates import applied_stamp
from mhsb_sim.report.recorded_motion import STANDSTILL, TipMotion

REST_WINDOW_NS = SECOND_NS // 5
"""The end of a rest, over which the tip's distance from its goal is taken."""


@dataclass(frozen=True)
class GoalRecord:
    """One goal that got its verdict.

    time_ns           ROS time of the verdict
    verdict           with code, position and what the plan was to cost
    outcome           of the execution, None where none was reported
    taken_over_ns     ROS time at which the simulator took its plan over, the last one where it was
                      planned again; None where it took none
    in_motion         whether the reference moved at that time
    distance_at_rest  m, mean distance of the measured tip from the goal over the last 0.2 s
                      before the next plan takes over or the recording ends; None unless the goal
                      was reached
    """

    time_ns: int
    verdict: GoalVerdict
    outcome: Outcome | None
    taken_over_ns: int | None
    in_motion: bool
    distance_at_rest: float | None


def take_overs(recording: Recording) -> dict[int, int]:
    """ROS time [ns] at which each executed plan took over, by the plan's stamp, in order."""
    times: dict[int, int] = {}
    for each in recording.plans_in_force:
        if each.value != 0:
            times.setdefault(each.value, each.time_ns)
    return times


def goal_records(
    recording: Recording, followed: Trajectory, tip: TipMotion
) -> tuple[GoalRecord, ...]:
    """All goals with a verdict, in the order of their verdicts.

    followed, tip  see `recorded_motion`
    """
    executions = {
        each.value.goal_stamp_ns: each.value
        for each in recording.reports
        if isinstance(each.value, ExecutionReport)
    }
    taken_over = take_overs(recording)
    records = []
    for each in recording.reports:
        verdict = each.value
        if not isinstance(verdict, GoalVerdict):
            continue
        execution = executions.get(verdict.goal_stamp_ns)
        outcome = None if execution is None else execution.outcome
        stamp_ns = applied_stamp(verdict, execution, taken_over)
        taken_over_ns = None if stamp_ns is None else taken_over.get(stamp_ns)
        distance = None
        if outcome is Outcome.REACHED and stamp_ns is not None and taken_over_ns is not None:
            distance = _distance_at_rest(recording, tip, verdict, stamp_ns)
        records.append(
            GoalRecord(
                each.time_ns,
                verdict,
                outcome,
                taken_over_ns,
                taken_over_ns is not None and _moves(followed, taken_over_ns),
                distance,
            )
        )
    return tuple(records)


def _moves(followed: Trajectory, time_ns: int) -> bool:
    """Whether the last reference before a time was moving."""
    row = int(np.searchsorted(followed.offset_ns, time_ns - followed.stamp_ns, "right")) - 1
    return bool(np.any(np.abs(followed.velocity[max(row, 0)]) > STANDSTILL))


def _distance_at_rest(
    recording: Recording, tip: TipMotion, verdict: GoalVerdict, stamp_ns: int
) -> float | None:
    taken_over = take_overs(recording)
    later = [time for time in taken_over.values() if time > taken_over[stamp_ns]]
    until_ns = min([*later, int(tip.time_ns[-1])])
    arrivals = [each.end_ns for each in recording.trajectories if each.stamp_ns == stamp_ns]
    since_ns = max([until_ns - REST_WINDOW_NS, *arrivals])
    window = (tip.time_ns >= since_ns) & (tip.time_ns <= until_ns)
    if not np.any(window):
        return None
    away = tip.measured[window] - verdict.goal.position
    return float(np.linalg.norm(away, axis=1).mean())
