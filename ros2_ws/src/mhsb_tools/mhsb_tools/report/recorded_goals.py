"""Evaluation of each goal in a recording, from its verdict to the tip's rest at the goal."""

from dataclasses import dataclass

import numpy as np

from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_model.verdict import ExecutionReport, GoalVerdict, Outcome
from mhsb_tools.recording.recording import Recording
from mhsb_tools.report.goal_fates import find_applied_stamp
from mhsb_tools.report.recorded_motion import REST_SPEED, TipMotion

REST_WINDOW_NS = SECOND_NS // 5
"""Time before the end of a rest over which the tip's distance from its goal is averaged [ns]."""


@dataclass(frozen=True)
class RecordedGoal:
    """A goal that got its verdict.

    Attributes:
        verdict: The verdict, with the goal and the predicted cost of its plan.
        outcome: Outcome of the execution; None if no execution was reported.
        taken_over_ns: ROS time at which the simulator took its plan over [ns], of the last plan if
            it was planned again; None if it took none over.
        in_motion: Whether the reference was moving at that time.
        distance_at_rest: Mean distance of the measured tip from the goal over the last 0.2 s before
            the next plan takes over or the recording ends [m]; None unless the goal was reached.
    """

    verdict: GoalVerdict
    outcome: Outcome | None
    taken_over_ns: int | None
    in_motion: bool
    distance_at_rest: float | None


def find_take_over_times(recording: Recording) -> dict[int, int]:
    """Return the time at which the arm began to follow each executed plan.

    Args:
        recording: The recording. Only `plans_in_force` is read.

    Returns:
        ROS time [ns] by the plan's stamp [ns], in the order of execution. If a plan took over
        twice, the first time counts. Times at which the arm held its position without a plan (stamp
        0) are left out.
    """
    times: dict[int, int] = {}
    for each in recording.plans_in_force:
        if each.value != 0:
            times.setdefault(each.value, each.time_ns)
    return times


def evaluate_goals(
    recording: Recording, followed: Trajectory, tip: TipMotion
) -> tuple[RecordedGoal, ...]:
    """Collect verdict, outcome, take-over time and final distance of each goal.

    Only goals that got a verdict are included.

    Args:
        recording: The recording.
        followed: References of the whole recording, joined into one trajectory.
        tip: Measured and reference motion of the tip.

    Returns:
        The goals in the order of their verdicts.
    """
    executions = {
        each.value.goal_stamp_ns: each.value
        for each in recording.reports
        if isinstance(each.value, ExecutionReport)
    }
    taken_over = find_take_over_times(recording)
    records = []
    for each in recording.reports:
        verdict = each.value
        if not isinstance(verdict, GoalVerdict):
            continue
        execution = executions.get(verdict.goal_stamp_ns)
        outcome = None if execution is None else execution.outcome
        stamp_ns = find_applied_stamp(verdict, execution, taken_over)
        taken_over_ns = None if stamp_ns is None else taken_over.get(stamp_ns)
        distance = None
        if outcome is Outcome.REACHED and stamp_ns is not None and taken_over_ns is not None:
            distance = _distance_at_rest(recording, tip, verdict, stamp_ns)
        records.append(
            RecordedGoal(
                verdict,
                outcome,
                taken_over_ns,
                taken_over_ns is not None and _is_moving(followed, taken_over_ns),
                distance,
            )
        )
    return tuple(records)


def _is_moving(followed: Trajectory, time_ns: int) -> bool:
    """Return whether the reference was moving at a time.

    Args:
        followed: References of the whole recording, joined into one trajectory.
        time_ns: ROS time [ns]. The last reference at or before it counts; if there is none, the
            first.

    Returns:
        True if the reference of any joint is faster than REST_SPEED.
    """
    row = int(np.searchsorted(followed.offset_ns, time_ns - followed.stamp_ns, "right")) - 1
    return bool(np.any(np.abs(followed.velocity[max(row, 0)]) > REST_SPEED))


def _distance_at_rest(
    recording: Recording, tip: TipMotion, verdict: GoalVerdict, stamp_ns: int
) -> float | None:
    """Return the mean distance of the resting tip from its goal.

    The mean is over a window of REST_WINDOW_NS that ends when the next plan takes over, or at the
    last measurement. If the goal's plan ends within this window, the window begins at the plan's
    end.

    Args:
        recording: The recording.
        tip: Measured motion of the tip.
        verdict: Verdict on the goal; it has the goal's position.
        stamp_ns: Stamp of the goal's plan [ns]; the plan must have taken over.

    Returns:
        The distance [m]; None if there is no measurement in the window.
    """
    taken_over = find_take_over_times(recording)
    later = [time for time in taken_over.values() if time > taken_over[stamp_ns]]
    until_ns = min([*later, int(tip.time_ns[-1])])
    arrivals = [each.end_ns for each in recording.trajectories if each.stamp_ns == stamp_ns]
    since_ns = max([until_ns - REST_WINDOW_NS, *arrivals])
    window = (tip.time_ns >= since_ns) & (tip.time_ns <= until_ns)
    if not np.any(window):
        return None
    away = tip.measured[window] - verdict.goal.position
    return float(np.linalg.norm(away, axis=1).mean())
