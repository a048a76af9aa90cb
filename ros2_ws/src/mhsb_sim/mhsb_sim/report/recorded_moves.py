"""The moves of a recording, one for each plan that was taken over."""

from __future__ import annotations

import numpy as np

from mhsb_model.trajectory import SECOND_NS
from mhsb_model.types import FloatArray, IntArray, Position
from mhsb_planner.evaluation.move import Move, energy_of_plan
from mhsb_planner.motion.energy import motion_energy
from mhsb_sim.recording.bag_format import BagError
from mhsb_sim.report.recorded_goals import GoalRecord
from mhsb_sim.report.recorded_motion import STANDSTILL, part
from mhsb_sim.report.recorded_run import RecordedRun

REST_NS = SECOND_NS // 2
"""After a motion that is shown with it."""


def recorded_moves(run: RecordedRun) -> list[Move]:
    """Each from where its plan took over to the next one, or to the rest at its end."""
    goals = [goal for goal in run.goals if goal.taken_over_ns is not None]
    if not goals:
        return []
    goals.sort(key=lambda goal: goal.taken_over_ns or 0)
    ends = [*(goal.taken_over_ns or 0 for goal in goals[1:]), run.followed.end_ns]
    moves = []
    for number, (goal, end_ns) in enumerate(zip(goals, ends, strict=True), start=1):
        time_ns = _instants(run, goal.taken_over_ns or 0, _until_rest(run, goal, end_ns))
        if len(time_ns) > 1:
            moves.append(_move(run, number, goal, time_ns))
    return moves


def whole_run(run: RecordedRun, title: str) -> tuple[Move, int]:
    """All that was recorded, as one move without a goal, and the ROS time of its beginning [ns].

    Raises BagError where no hydraulic states were recorded.
    """
    time_ns = _instants(run, run.followed.stamp_ns, run.followed.end_ns)
    if len(time_ns) < 2:
        raise BagError("the recording has no actuator_states; was the simulator running?")
    return _measured(run, title, (), time_ns), int(time_ns[0])


def _until_rest(run: RecordedRun, goal: GoalRecord, end_ns: int) -> int:
    """When the reference has come to rest after a goal, at the latest the end [ns]."""
    since_ns = goal.taken_over_ns or 0
    time_ns = run.followed.stamp_ns + run.followed.offset_ns
    moving = np.any(np.abs(run.followed.velocity) > STANDSTILL, axis=1)
    moving &= (time_ns > since_ns) & (time_ns < end_ns)
    last_ns = int(time_ns[moving][-1]) if np.any(moving) else since_ns
    return min(end_ns, last_ns + REST_NS)


def _instants(run: RecordedRun, begin_ns: int, end_ns: int) -> IntArray:
    """Times of the hydraulic states between two others, and within all that was followed [ns]."""
    time_ns = run.recording.actuators.time_ns
    low, high = max(begin_ns, run.followed.stamp_ns), min(end_ns, run.followed.end_ns)
    return time_ns[(time_ns >= low) & (time_ns <= high)]


def _move(run: RecordedRun, number: int, goal: GoalRecord, time_ns: IntArray) -> Move:
    sent = goal.verdict.goal
    fate = goal.outcome.value if goal.outcome else "under way"
    title = f"Goal {number}: {sent.place}, as recorded, {fate}"
    return _measured(run, title, (sent.position,), time_ns)


def _measured(
    run: RecordedRun, title: str, goals: tuple[Position, ...], time_ns: IntArray
) -> Move:
    states, table = run.recording.joint_states, run.recording.actuators
    rows = np.searchsorted(table.time_ns, time_ns)
    quantity = {name: values[rows] for name, values in table.quantity.items()}
    path = part(run.followed, int(time_ns[0]), int(time_ns[-1]))
    return Move(
        machine=run.machine,
        title=title,
        goals=goals,
        time=(time_ns - time_ns[0]) / SECOND_NS,
        position=_at(time_ns, states.time_ns, states.position),
        reference=run.followed.sample_many(time_ns)[0],
        modes=run.modes.modes_at_many(time_ns),
        speed=quantity["piston_speed"],
        force=quantity["force"],
        supply=quantity["supply_pressure"],
        chambers={"cap side": quantity["cap_pressure"], "rod side": quantity["rod_pressure"]},
        energy=energy_of_plan(motion_energy(run.machine, path, run.modes)),
        counted="the planner's model of what was followed",
    )


def _at(time_ns: IntArray, known_ns: IntArray, values: FloatArray) -> FloatArray:
    """Columns of values float64[m, n], known at some times, at others."""
    at, known = (each - known_ns[0] for each in (time_ns, known_ns))
    return np.column_stack([np.interp(at, known, column) for column in values.T])
