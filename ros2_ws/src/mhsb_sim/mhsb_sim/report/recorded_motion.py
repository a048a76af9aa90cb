"""The recorded motion: what the servo followed, and the tip measured against it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import Trajectory
from mhsb_model.types import FloatArray, IntArray
from mhsb_sim.recording.bag_format import BagError
from mhsb_sim.recording.recording import TIME_RUNS_BACKWARDS, Recording

STANDSTILL = 1e-6
"""References slower than this stand still [rad/s]."""


@dataclass(frozen=True, eq=False)
class TipMotion:
    """The tip at the times of the measured joint states, k of them.

    time_ns    int64[k], ROS time
    measured   float64[k, 2 or 3], in `base_link`, of the measured joints [m]
    reference  float64[k, 2 or 3], of what the servo followed at the same times [m]
    moving     bool[k], from the first to the last moment at which the reference moved
    """

    time_ns: IntArray
    measured: FloatArray
    reference: FloatArray
    moving: np.ndarray

    @property
    def error(self) -> FloatArray:
        """Distance of the measured tip from the reference, float64[k] m."""
        return np.linalg.norm(self.measured - self.reference, axis=1)


def tip_motion(recording: Recording, machine: Machine, followed: Trajectory) -> TipMotion:
    """The recorded tip over the time in which both measurement and reference are there."""
    states = recording.joint_states
    both = (states.time_ns >= followed.stamp_ns) & (states.time_ns <= followed.end_ns)
    if not np.any(both):
        raise BagError("joint_states and reference of the recording do not overlap in time")
    time_ns = states.time_ns[both]
    reference, velocity, _ = followed.sample_many(time_ns)
    return TipMotion(
        time_ns,
        machine.tip_in_base(states.position[both]),
        machine.tip_in_base(reference),
        _first_to_last(np.any(np.abs(velocity) > STANDSTILL, axis=1)),
    )


def followed_trajectory(recording: Recording) -> Trajectory:
    """The references of a whole recording as one curve.

    Each sample has position, velocity and acceleration, so that the quintic between two of them
    is the curve of the plan to rounding. Raises BagError where there are no references, or where
    their time runs backwards.
    """
    references = recording.references
    if len(references.time_ns) == 0:
        raise BagError("the recording has no references; was the simulator running?")
    offset_ns = references.time_ns - references.time_ns[0]
    if np.any(np.diff(offset_ns) <= 0):
        raise BagError(TIME_RUNS_BACKWARDS)
    return Trajectory(
        int(references.time_ns[0]),
        offset_ns,
        references.position,
        references.velocity,
        references.acceleration,
    )


def part(trajectory: Trajectory, begin_ns: int, end_ns: int) -> Trajectory:
    """The piece of a trajectory between two absolute times that lie within it [ns]."""
    points = trajectory.stamp_ns + trajectory.offset_ns
    inside = points[(points > begin_ns) & (points < end_ns)]
    time_ns = np.concatenate([[begin_ns], inside, [end_ns]])
    return Trajectory(begin_ns, time_ns - begin_ns, *trajectory.sample_many(time_ns))


def modes_in_force(recording: Recording) -> ModeSchedule:
    """The recorded modes as one schedule, a row for each change.

    Raises BagError where no modes were recorded.
    """
    if len(recording.mode_time_ns) == 0:
        raise BagError("the recording has no modes; was the simulator running?")
    changed = np.any(np.diff(recording.modes.astype(np.int64), axis=0) != 0, axis=1)
    rows = np.flatnonzero(np.concatenate([[True], changed]))
    time_ns = recording.mode_time_ns[rows]
    last_at_its_time = np.concatenate([np.diff(time_ns) > 0, [True]])
    time_ns, rows = time_ns[last_at_its_time], rows[last_at_its_time]
    return ModeSchedule(int(time_ns[0]), time_ns - time_ns[0], recording.modes[rows])


def _first_to_last(flags: np.ndarray) -> np.ndarray:
    """All from the first to the last that is set."""
    between = np.logical_or.accumulate(flags)
    between &= np.logical_or.accumulate(flags[::-1])[::-1]
    return between
