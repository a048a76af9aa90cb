"""How well a goal that moves was followed, of a recording in which goals streamed."""

from __future__ import annotations

from collections import Counter

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.types import FloatArray, IntArray
from mhsb_model.verdict import GoalVerdict
from mhsb_sim.recording.recording import Recording
from mhsb_sim.report.summary import Summary, jumps, spread

AFTER_TURNING = SECOND_NS // 2
MILLI = 1e3


def stream_figures(recording: Recording, machine: Machine) -> Summary:
    """Figures of goals that all lie on the way of one goal that moves.

    verdicts           how many of each code
    plans_per_s        plans that the arm executed
    behind_mm          measured tip to goal at the same instant, while the goal moves; its turning
                       points and 0.5 s after them excepted
    """
    sent_ns = np.array([each.time_ns for each in recording.goals])
    goals = np.array([each.value.position for each in recording.goals])
    duration = (sent_ns[-1] - sent_ns[0]) / SECOND_NS
    executed = {each.value for each in recording.plans_in_force if each.value}
    codes = Counter(
        each.value.code.name for each in recording.reports if isinstance(each.value, GoalVerdict)
    )
    measured = recording.joint_states
    behind = _behind(
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
        "behind_mm": spread((MILLI * behind).tolist()),
        **jumps(recording),
    }


def _behind(
    sent_ns: IntArray, goals: FloatArray, time_ns: IntArray, tip: FloatArray
) -> FloatArray:
    """Distances of the tip, float64[k, axes], from the goal at the times int64[k] [m]."""
    step = np.diff(goals, axis=0)
    turned = np.flatnonzero((step[1:] * step[:-1]).sum(axis=1) <= 0.0) + 1
    turns_ns = np.concatenate([sent_ns[:1], sent_ns[turned]])
    counts = (time_ns > sent_ns[0]) & (time_ns < sent_ns[-1])
    last_turn_ns = turns_ns[np.clip(np.searchsorted(turns_ns, time_ns) - 1, 0, None)]
    counts &= time_ns - last_turn_ns > AFTER_TURNING
    there = np.column_stack([np.interp(time_ns[counts], sent_ns, row) for row in goals.T])
    return np.asarray(np.linalg.norm(tip[counts] - there, axis=1))
