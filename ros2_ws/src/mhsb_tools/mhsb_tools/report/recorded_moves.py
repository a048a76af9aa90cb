"""Moves of a recording, one for each goal whose plan was taken over."""

import numpy as np

from mhsb_model.trajectory import SECOND_NS
from mhsb_model.types import FloatArray, IntArray, Position
from mhsb_planner.motion.energy import compute_motion_energy
from mhsb_tools.moves.move import MoveRecord, split_energy
from mhsb_tools.moves.supply_systems import compute_single_supply
from mhsb_tools.recording.bag_format import BagError
from mhsb_tools.report.recorded_goals import RecordedGoal
from mhsb_tools.report.recorded_motion import REST_SPEED, cut_trajectory
from mhsb_tools.report.recorded_run import EvaluatedRecording

REST_NS = SECOND_NS // 2
"""Duration of the rest that is shown after a motion [ns]."""


def cut_into_moves(run: EvaluatedRecording) -> list[MoveRecord]:
    """Cut a recording into moves, one for each goal whose plan took over.

    A move begins when the goal's plan takes over. It ends when the next goal's plan takes over, or
    earlier: REST_NS after the reference has come to rest. Moves with fewer than two recorded
    hydraulic states are not in the result.

    Args:
        run: The evaluated recording.

    Returns:
        The moves in the order of execution. A title has the goal's number (from 1, also counting
        goals whose move is left out), its position and its outcome, or "under way" without one.
    """
    goals = [goal for goal in run.goals if goal.taken_over_ns is not None]
    if not goals:
        return []
    goals.sort(key=lambda goal: goal.taken_over_ns or 0)
    ends = [*(goal.taken_over_ns or 0 for goal in goals[1:]), run.reference.end_ns]
    moves = []
    for number, (goal, end_ns) in enumerate(zip(goals, ends, strict=True), start=1):
        time_ns = _find_hydraulic_times(
            run, goal.taken_over_ns or 0, _find_end_of_move(run, goal, end_ns)
        )
        if len(time_ns) > 1:
            sent = goal.verdict.goal
            fate = goal.outcome.value if goal.outcome else "under way"
            title = f"Goal {number}: {sent.position_text}, as recorded, {fate}"
            moves.append(_make_move(run, title, (sent.position,), time_ns))
    return moves


def get_whole_run_as_move(run: EvaluatedRecording, title: str) -> tuple[MoveRecord, int]:
    """Return the whole recording as one move without a goal.

    Args:
        run: The evaluated recording.
        title: Title of the move.

    Returns:
        The move, and the ROS time at which it begins [ns]. It begins and ends with the first and
        last hydraulic state for which there is a reference.

    Raises:
        BagError: There are fewer than two such hydraulic states.
    """
    time_ns = _find_hydraulic_times(run, run.reference.stamp_ns, run.reference.end_ns)
    if len(time_ns) < 2:
        raise BagError("the recording has no actuator_states; was the simulator running?")
    return _make_move(run, title, (), time_ns), int(time_ns[0])


def _find_end_of_move(run: EvaluatedRecording, goal: RecordedGoal, end_ns: int) -> int:
    """Return the time at which a goal's move ends.

    Args:
        run: The evaluated recording. Only `reference` is read.
        goal: Goal whose plan took over. Only `taken_over_ns` is read.
        end_ns: Latest end [ns, ROS time]: the time at which the next plan takes over or the
            references end.

    Returns:
        ROS time [ns], at most `end_ns`. The references between the take-over of the goal's plan and
        `end_ns` count. The move ends REST_NS after the last of them in which a joint is faster than
        REST_SPEED. If there is none, it ends REST_NS after the take-over.
    """
    since_ns = goal.taken_over_ns or 0
    time_ns = run.reference.stamp_ns + run.reference.offset_ns
    moving = np.any(np.abs(run.reference.velocity) > REST_SPEED, axis=1)
    moving &= (time_ns > since_ns) & (time_ns < end_ns)
    last_ns = int(time_ns[moving][-1]) if np.any(moving) else since_ns
    return min(end_ns, last_ns + REST_NS)


def _find_hydraulic_times(run: EvaluatedRecording, begin_ns: int, end_ns: int) -> IntArray:
    """Return the times of the hydraulic states in an interval for which there is a reference.

    Args:
        run: The evaluated recording.
        begin_ns: Beginning of the interval [ns, ROS time].
        end_ns: End of the interval [ns, ROS time].

    Returns:
        ROS times, int64 (k,) [ns], possibly none. States at the ends of the interval are included.
    """
    time_ns = run.recording.actuators.time_ns
    low, high = max(begin_ns, run.reference.stamp_ns), min(end_ns, run.reference.end_ns)
    return time_ns[(time_ns >= low) & (time_ns <= high)]


def _make_move(
    run: EvaluatedRecording, title: str, goals: tuple[Position, ...], time_ns: IntArray
) -> MoveRecord:
    """Collect recorded motion, hydraulic states and energy of a time span as a move.

    Measured joint positions are interpolated linearly to the times of the hydraulic states. The
    energy flow is computed by the planner's model from the reference and the modes in force. Its
    title has the measured energy, too.

    Args:
        run: The evaluated recording.
        title: Title of the move.
        goals: Goals in `base_link` [m]; empty for none.
        time_ns: Times of hydraulic states, int64 (k,) [ns, ROS time], k ≥ 2.

    Returns:
        The move; its time 0 is the first of `time_ns`.
    """
    states, table = run.recording.joint_states, run.recording.actuators
    rows = np.searchsorted(table.time_ns, time_ns)
    quantity = {name: values[rows] for name, values in table.quantity.items()}
    path = cut_trajectory(run.reference, int(time_ns[0]), int(time_ns[-1]))
    energy = compute_motion_energy(run.machine, path, run.modes)
    saving = compute_single_supply(run.machine, path).describe_saving(energy.series)
    measured = energy.series + run.energy.compute_excess(int(time_ns[0]), int(time_ns[-1]))
    known = f"{measured:.0f} J measured" if np.isfinite(measured) else "not measured"
    return MoveRecord(
        machine=run.machine,
        title=title,
        goals=goals,
        time=(time_ns - time_ns[0]) / SECOND_NS,
        position=_interpolate_columns(time_ns, states.time_ns, states.position),
        reference=run.reference.sample_many(time_ns)[0],
        modes=run.modes.modes_at_many(time_ns),
        speed=quantity["piston_speed"],
        force=quantity["force"],
        supply=quantity["supply_pressure"],
        chambers={"cap side": quantity["cap_pressure"], "rod side": quantity["rod_pressure"]},
        energy=split_energy(energy),
        energy_title=f"energy: {known}; drawn by the planner's model:\n" + saving,
    )


def _interpolate_columns(time_ns: IntArray, known_ns: IntArray, values: FloatArray) -> FloatArray:
    """Interpolate columns of values linearly in time.

    Args:
        time_ns: Wanted times, int64 (k,) [ns].
        known_ns: Times of the values, int64 (m,) [ns], not decreasing.
        values: Values, shape (m, n).

    Returns:
        Values at the wanted times, shape (k, n). Before the first and after the last known time,
        the first and last values are used.
    """
    at, known = (each - known_ns[0] for each in (time_ns, known_ns))
    return np.column_stack([np.interp(at, known, column) for column in values.T])
