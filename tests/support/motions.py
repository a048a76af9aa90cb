"""Torques of a motion and states inside of a trajectory's intervals, which tests compare with."""

from __future__ import annotations

import numpy as np

from mhsb_model import statics
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS, Trajectory, quintic_hermite
from mhsb_model.types import FloatArray, IntArray


def inverse_dynamics(
    machine: Machine, q: FloatArray, qd: FloatArray, qdd: FloatArray
) -> FloatArray:
    """Compute the joint torques of a motion, gravity included.

    Args:
        machine: The machine.
        q: Joint positions, shape (n,) [rad or m].
        qd: Joint velocities, shape (n,) [rad/s or m/s].
        qdd: Joint accelerations, shape (n,) [rad/s² or m/s²].

    Returns:
        Torques τ = M q̈ + C q̇ + g, shape (n,) [N m], or [N] for a sliding joint.
    """
    weight, torque = np.empty(machine.joint_count), np.empty(machine.joint_count)
    work = np.empty((statics.MOTION_WORK, machine.joint_count))
    state = (np.array(values, dtype=np.float64) for values in (q, qd, qdd))
    statics.compute_motion_torques(statics.get_chain(machine.arrays), *state, work, weight, torque)
    return torque


def sample_intervals(
    trajectory: Trajectory, rows: IntArray, shares: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Evaluate a trajectory at the same shares of several intervals.

    Args:
        trajectory: The trajectory.
        rows: Indices of the intervals, shape (rows,). Interval i lasts from point i to point i + 1.
        shares: Instants within each interval as shares of its duration, 0 … 1, shape (shares,).

    Returns:
        Positions, velocities and accelerations, each of shape (rows · shares, n). All shares of the
        first interval come first, then all of the second, and so on.
    """
    i = np.repeat(rows, len(shares))
    h = (np.diff(trajectory.offset_ns)[i] / SECOND_NS)[:, None]
    curve = trajectory.position, trajectory.velocity, trajectory.acceleration
    start, end = (tuple(values[k] for values in curve) for k in (i, i + 1))
    return quintic_hermite(np.tile(shares, len(rows))[:, None] * h, h, start, end)
