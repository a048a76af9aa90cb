"""Conversion of smooth curves to the points of a trajectory."""

from typing import Protocol

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.trajectory import MAX_POINT_SPACING_NS, SECOND_NS, MotionState, Trajectory
from mhsb_model.types import FloatArray, IntArray

FEWEST_INTERVALS = 10
"""Least number of intervals between a trajectory's points."""


class Curve(Protocol):
    """Joint motion along a discrete path that can be sampled at any time."""

    @property
    def node_time(self) -> FloatArray:
        """Time at which the motion is to be at each node of the path, shape (k + 1,) [s]."""

    @property
    def breaks(self) -> FloatArray:
        """Times between which the curve is smooth, from 0 to its end [s]."""

    def sample(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Compute the joint motion at given times.

        Args:
            time: Times in ascending order, shape (m,) [s].

        Returns:
            Joint positions [rad or m], velocities [rad/s or m/s] and accelerations
            [rad/s² or m/s²], of shape (m, n).
        """


def sample_curve(curve: Curve, start: MotionState, end: FloatArray) -> Trajectory:
    """Sample a curve as a trajectory with stamp 0.

    The first point is set to `start`, and the last one to rest at `end`. A polynomial may begin or
    end with another acceleration. The first and the last interval of the trajectory then lead from
    one acceleration to the other.

    Args:
        curve: Joint motion.
        start: State of the joints at the start.
        end: Joint positions at the end, shape (n,) [rad or m].

    Returns:
        Trajectory with points at the curve's `breaks`, and points evenly spread between these.
    """
    offset = choose_point_times(curve.breaks)
    q, qd, qdd = curve.sample(offset / SECOND_NS)
    q[0], qd[0], qdd[0] = start.position, start.velocity, start.acceleration
    q[-1], qd[-1], qdd[-1] = end, 0.0, 0.0
    return Trajectory(0, offset, q, qd, qdd)


def join_trajectories(lead_in: Trajectory, curve: Trajectory) -> Trajectory:
    """Join two trajectories into one with stamp 0.

    Args:
        lead_in: First trajectory. It must end in the state of motion in which the second trajectory
            begins.
        curve: Second trajectory.

    Returns:
        Joined trajectory, in which the common point appears once. The stamps of both trajectories
        are ignored.
    """
    return Trajectory(
        0,
        np.concatenate([lead_in.offset_ns[:-1], lead_in.duration_ns + curve.offset_ns]),
        np.vstack([lead_in.position[:-1], curve.position]),
        np.vstack([lead_in.velocity[:-1], curve.velocity]),
        np.vstack([lead_in.acceleration[:-1], curve.acceleration]),
    )


@kernel
def choose_point_times(breaks: FloatArray) -> IntArray:
    """Choose the times of a trajectory's points on a curve.

    The points lie at the breaks and are evenly spread between them. They are so close that quintics
    between them follow the curve within rounding.

    Args:
        breaks: Times between which the curve is smooth, ascending from 0, shape (k,) [s].

    Returns:
        Times in ascending order, at most MAX_POINT_SPACING_NS apart [ns]. There are at least
        FEWEST_INTERVALS intervals.
    """
    at_ns, spans = np.empty(len(breaks), dtype=np.int64), len(breaks) - 1
    for i in range(len(breaks)):
        at_ns[i] = np.int64(np.rint(breaks[i] * SECOND_NS))
    parts, fewest = np.empty(spans, dtype=np.int64), -(-FEWEST_INTERVALS // spans)
    intervals = 0
    for i in range(spans):
        parts[i] = max(-(-(at_ns[i + 1] - at_ns[i]) // MAX_POINT_SPACING_NS), fewest)
        intervals += parts[i]
    times, k = np.empty(intervals + 1, dtype=np.int64), 0
    for i in range(spans):
        step = (at_ns[i + 1] - at_ns[i]) / parts[i]
        for part in range(parts[i]):
            times[k] = at_ns[i] + np.int64(np.rint(part * step))
            k += 1
    times[k] = at_ns[-1]
    return times
