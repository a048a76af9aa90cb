"""Tracking of a moving goal in a recording in which goals were streamed."""

from __future__ import annotations

from collections import Counter

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.types import FloatArray, IntArray
from mhsb_model.verdict import GoalVerdict
from mhsb_tools.recording.recording import Recording
from mhsb_tools.report.summary import Summary, compute_quantiles, compute_reference_jumps

AFTER_TURNING = SECOND_NS // 2
"""Time after a turning point of the goal that is not evaluated [ns]."""

PER_MILLI = 1e3


def compute_tracking_figures(recording: Recording, machine: Machine) -> Summary:
    """Compute how closely the arm tracked a moving goal, with counts of verdicts and plans.

    Args:
        recording: Recording of goals that all lie on the path of one moving goal; at least two.
        machine: Its machine.

    Returns:
        Numbers by name.

        - `goals`: Number of readable goals.
        - `duration_s`: Time from the first to the last goal.
        - `verdicts`: Number of verdicts by code.
        - `plans_per_s`: Executed plans per second.
        - `behind_mm`: Distance of the measured tip from the goal at the same instant, as `p50`,
            `p99` and `max`. Turning points of the goal and 0.5 s after them are left out.
        - `reference_jump_max_rad`, `reference_jump_max_rad_s`: Largest steps of the reference at
            hand-overs.
    """
    sent_ns = np.array([each.time_ns for each in recording.goals])
    goals = np.array([each.value.position for each in recording.goals])
    duration = (sent_ns[-1] - sent_ns[0]) / SECOND_NS
    executed = {each.value for each in recording.plans_in_force if each.value}
    codes = Counter(
        each.value.code.name for each in recording.reports if isinstance(each.value, GoalVerdict)
    )
    measured = recording.joint_states
    behind = _compute_goal_distances(
        sent_ns,
        goals,
        measured.time_ns,
        machine.tip_in_base(measured.position),
    )
    return {
        "goals": len(goals),
        "duration_s": float(duration),
        "verdicts": dict(codes),
        "plans_per_s": len(executed) / float(duration),
        "behind_mm": compute_quantiles((PER_MILLI * behind).tolist()),
        **compute_reference_jumps(recording),
    }


def _compute_goal_distances(
    sent_ns: IntArray, goals: FloatArray, time_ns: IntArray, tip: FloatArray
) -> FloatArray:
    """Compute the distance of the tip from the moving goal at the times of the tip positions.

    The goal is interpolated linearly in time between the goals that were sent. It turns at a goal
    if the steps to it and from it have a scalar product of 0 or less, so also if it stands still.
    Times within AFTER_TURNING after a turn or after the first goal are left out, and times before
    the first or after the last goal.

    Args:
        sent_ns: ROS time of each goal, int64 (m,) [ns].
        goals: Position of each goal, shape (m, 2 or 3) [m].
        time_ns: ROS time of each tip position, int64 (k,) [ns].
        tip: Tip positions, shape (k, 2 or 3) [m].

    Returns:
        Distances at the evaluated times [m], at most k of them.
    """
    step = np.diff(goals, axis=0)
    turned = np.flatnonzero((step[1:] * step[:-1]).sum(axis=1) <= 0.0) + 1
    turns_ns = np.concatenate([sent_ns[:1], sent_ns[turned]])
    counts = (time_ns > sent_ns[0]) & (time_ns < sent_ns[-1])
    last_turn_ns = turns_ns[np.clip(np.searchsorted(turns_ns, time_ns) - 1, 0, None)]
    counts &= time_ns - last_turn_ns > AFTER_TURNING
    there = np.column_stack([np.interp(time_ns[counts], sent_ns, row) for row in goals.T])
    return np.asarray(np.linalg.norm(tip[counts] - there, axis=1))
