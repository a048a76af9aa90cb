"""Recorded motion: the reference that the servo followed, and the measured tip against it."""

from dataclasses import dataclass

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import Trajectory
from mhsb_model.types import FloatArray, IntArray
from mhsb_tools.recording.bag_format import BagError
from mhsb_tools.recording.recording import TIME_RUNS_BACKWARDS, Recording

REST_SPEED = 1e-6
"""Largest joint speed with which the reference counts as at rest [rad/s or m/s]."""


@dataclass(frozen=True, eq=False)
class TipMotion:
    """Motion of the tip at the k times of the measured joint states.

    Positions are in `base_link`: (x, z), or (x, y, z) if the arm slews.

    Attributes:
        time_ns: ROS time, int64 (k,) [ns].
        measured: Tip position by the measured joints, shape (k, 2 or 3) [m].
        reference: Tip position by the reference, shape (k, 2 or 3) [m].
        moving: True from the first to the last time at which the reference moved, rests between
            included, bool (k,).
    """

    time_ns: IntArray
    measured: FloatArray
    reference: FloatArray
    moving: np.ndarray

    @property
    def error(self) -> FloatArray:
        """Distance of the measured tip from the reference, shape (k,) [m]."""
        return np.linalg.norm(self.measured - self.reference, axis=1)


def compute_tip_motion(recording: Recording, machine: Machine, followed: Trajectory) -> TipMotion:
    """Compute measured and reference position of the tip at the times of the joint states.

    Args:
        recording: The recording. Only `joint_states` is read.
        machine: Its machine.
        followed: References of the whole recording, joined into one trajectory.

    Returns:
        Motion of the tip. Joint states before the first or after the last reference are left out.
        `moving` is True from the first to the last time at which the reference moves, rests between
        included.

    Raises:
        BagError: Joint states and references do not overlap in time.
    """
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
        _fill_between_first_and_last(np.any(np.abs(velocity) > REST_SPEED, axis=1)),
    )


def join_references(recording: Recording) -> Trajectory:
    """Join all references in a recording to one trajectory.

    A reference is what the servo follows at one time: position, velocity and acceleration of all
    joints. The references become the points of the trajectory, with quintics in between.

    Args:
        recording: The recording. Only `references` is read.

    Returns:
        The trajectory; its stamp is the ROS time of the first reference.

    Raises:
        BagError: There are no references, or their time does not increase.
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


def cut_trajectory(trajectory: Trajectory, begin_ns: int, end_ns: int) -> Trajectory:
    """Return the piece of a trajectory between two times.

    Args:
        trajectory: The trajectory.
        begin_ns: Absolute time at which the piece begins [ns], within the trajectory.
        end_ns: Absolute time at which the piece ends [ns], within the trajectory.

    Returns:
        A new trajectory with stamp `begin_ns`. Its points are those of `trajectory` in between, and
        one at each end.
    """
    points = trajectory.stamp_ns + trajectory.offset_ns
    inside = points[(points > begin_ns) & (points < end_ns)]
    time_ns = np.concatenate([[begin_ns], inside, [end_ns]])
    return Trajectory(begin_ns, time_ns - begin_ns, *trajectory.sample_many(time_ns))


def join_modes(recording: Recording) -> ModeSchedule:
    """Convert the modes in a recording to one schedule.

    Args:
        recording: The recording; it has the modes of all actuators at many times.

    Returns:
        The schedule. Its first row has the first recorded modes, and each further row a change of
        one or more modes. If several changes have the same time, the last change is kept.

    Raises:
        BagError: No modes were recorded.
    """
    if len(recording.mode_time_ns) == 0:
        raise BagError("the recording has no modes; was the simulator running?")
    changed = np.any(np.diff(recording.modes.astype(np.int64), axis=0) != 0, axis=1)
    rows = np.flatnonzero(np.concatenate([[True], changed]))
    time_ns = recording.mode_time_ns[rows]
    last_at_its_time = np.concatenate([np.diff(time_ns) > 0, [True]])
    time_ns, rows = time_ns[last_at_its_time], rows[last_at_its_time]
    return ModeSchedule(int(time_ns[0]), time_ns - time_ns[0], recording.modes[rows])


def _fill_between_first_and_last(flags: np.ndarray) -> np.ndarray:
    """Return a copy of flags in which all elements from the first True to the last True are True.

    Args:
        flags: Flags, bool of shape (k,); not changed.

    Returns:
        Flags, bool of shape (k,); all False if `flags` has no True.
    """
    between = np.logical_or.accumulate(flags)
    between &= np.logical_or.accumulate(flags[::-1])[::-1]
    return between
