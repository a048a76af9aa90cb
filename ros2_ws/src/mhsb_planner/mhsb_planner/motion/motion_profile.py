"""Actuator quantities along a joint motion: piston speeds and forces, and the tip's path."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.kinematics import add_extension
from mhsb_model.linkages.linkage import evaluate_linkage, evaluate_linkage_at_cosine
from mhsb_model.machine import Machine
from mhsb_model.statics import (
    INERTIA_WORK,
    compute_chain_gravity_torques,
    compute_inertia_torques,
    get_chain,
)
from mhsb_model.trajectory import SECOND_NS, JointMotion, Trajectory, sample_midpoint_states
from mhsb_model.types import FloatArray, as_frozen


@dataclass(frozen=True, eq=False)
class MotionProfile:
    """Actuator quantities along a motion, one row for each of k instants.

    r = dL/dq is the moment arm, the change of the cylinder length with the joint position. τ_g is
    the joint torque of gravity. M is the mass matrix and C q̇ the torques from joint velocities.

    Attributes:
        speed: Piston speeds v = r(q) q̇, positive in extension, shape (k, n) [m/s].
        force: Piston forces under gravity F = τ_g(q)/r(q), positive if they resist extension,
            shape (k, n) [N].
        tip: Tip positions (x, z), shape (k, 2) [m].
        inertia: Piston forces from inertia (M q̈ + C q̇)/r, to be added to F, shape (k, n) [N]. All
            0 if accelerations were not given.
        position: Joint positions, shape (k, n) [rad or m].
    """

    speed: FloatArray
    force: FloatArray
    tip: FloatArray
    inertia: FloatArray
    position: FloatArray

    def __getitem__(self, rows: slice) -> MotionProfile:
        """Return the profile of a slice of the instants.

        Args:
            rows: Slice of instants.

        Returns:
            Profile whose arrays are views of this profile's arrays.
        """
        return MotionProfile(
            self.speed[rows],
            self.force[rows],
            self.tip[rows],
            self.inertia[rows],
            self.position[rows],
        )


def compute_motion_profile(
    machine: Machine,
    position: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray | None = None,
) -> MotionProfile:
    """Compute the piston speeds, piston forces and tip positions of k motion states.

    Args:
        machine: Machine with its payload.
        position: Joint positions, shape (k, n) [rad or m].
        velocity: Joint velocities, shape (k, n) [rad/s or m/s].
        acceleration: Joint accelerations, shape (k, n) [rad/s² or m/s²]. None makes all inertia
            forces 0, including those that joint velocities cause.

    Returns:
        Profile with k rows: piston speeds [m/s], piston forces under gravity [N], piston forces
        from inertia [N], tip positions [m] and joint positions [rad or m].
    """
    qdd = np.empty((0, position.shape[1])) if acceleration is None else acceleration
    q = as_frozen(position)
    speed, force, tip, inertia = _compute_profile(
        machine.arrays, q, as_frozen(velocity), as_frozen(qdd)
    )
    return MotionProfile(speed, force, tip, inertia, q)


def compute_middle_profile(machine: Machine, trajectory: Trajectory) -> MotionProfile:
    """Compute the profile of a trajectory half-way in time between its points.

    Args:
        machine: Machine with its payload.
        trajectory: Joint trajectory of k points.

    Returns:
        Profile with k - 1 rows: piston speeds, piston forces under gravity, piston forces from
        inertia, tip positions and joint positions.
    """
    time = trajectory.offset_ns / SECOND_NS
    profile = _compute_middle_profile(machine.arrays, time, *trajectory.points)
    profile[-1].setflags(write=False)  # as in each profile
    return MotionProfile(*profile)


@kernel
def _compute_middle_profile(
    m: MachineArrays,
    time: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Compute the profile of a trajectory half-way in time between its points.

    Tested against the profile of states from `Trajectory.sample_many`.

    Args:
        m: Arrays of the machine, with its payload.
        time: Times of the points, increasing, shape (k,) [s].
        position: Joint positions at the points, shape (k, n) [rad or m].
        velocity: Joint velocities at the points, shape (k, n) [rad/s or m/s].
        acceleration: Joint accelerations at the points, shape (k, n) [rad/s² or m/s²].

    Returns:
        Fields of `MotionProfile` in their order, with k - 1 rows.
    """
    q, qd, qdd = sample_midpoint_states(time, position, velocity, acceleration)
    speed, force, tip, inertia = compute_profile_arrays(m, q, qd, qdd)
    return speed, force, tip, inertia, q


@kernel
def _compute_profile(
    m: MachineArrays, position: FloatArray, velocity: FloatArray, acceleration: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Compute piston speeds, gravity forces, tip positions and inertia forces from frozen arrays.

    This kernel calls `compute_profile_arrays` with writable copies, because all other kernels call
    it with writable arrays. Otherwise numba would compile it twice, which takes longer than
    copying.

    Args:
        m: Arrays of the machine, with its payload.
        position: Joint positions, shape (k, n) [rad or m]. May be read-only.
        velocity: Joint velocities, shape (k, n) [rad/s or m/s]. May be read-only.
        acceleration: Joint accelerations, shape (k, n) [rad/s² or m/s²]. May be read-only. An
            array without rows makes the inertia forces 0.

    Returns:
        Piston speeds, shape (k, n) [m/s]; piston forces under gravity, shape (k, n) [N]; tip
        positions (x, z), shape (k, 2) [m]; piston forces from inertia, shape (k, n) [N].
    """
    return compute_profile_arrays(m, position.copy(), velocity.copy(), acceleration.copy())


@kernel
def compute_profile_arrays(
    m: MachineArrays, position: FloatArray, velocity: FloatArray, acceleration: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Compute piston speeds, gravity forces, tip positions and inertia forces of k states.

    Tested against the methods of `Machine`.

    Args:
        m: Arrays of the machine, with its payload.
        position: Joint positions, shape (k, n) [rad or m].
        velocity: Joint velocities, shape (k, n) [rad/s or m/s].
        acceleration: Joint accelerations, shape (k, n) [rad/s² or m/s²]. An array without rows
            makes the inertia forces 0.

    Returns:
        Piston speeds, positive in extension, shape (k, n) [m/s]; piston forces under gravity,
        positive if they resist extension, shape (k, n) [N]; tip positions (x, z), shape (k, 2) [m];
        piston forces from inertia, to be added to the gravity forces, shape (k, n) [N].
    """
    rows, n = position.shape
    speed, force, tip = np.empty((rows, n)), np.empty((rows, n)), np.zeros((rows, 2))
    inertia = np.zeros((rows, n))
    chain, linkage, moves = get_chain(m), m.linkage, len(acceleration) > 0
    cosine, sine = np.empty(n), np.empty(n)
    arm, weight, push, work = np.empty(n), np.empty(n), np.zeros(n), np.empty((INERTIA_WORK, n))
    for k in range(rows):
        along, across = 1.0, 0.0  # direction of the link before
        q = position[k]
        for j in range(n):
            if chain.turns[j]:
                c, s = math.cos(q[j]), math.sin(q[j])
                _, arm[j], _ = evaluate_linkage_at_cosine(linkage[j], c, s)
                along, across = along * c - across * s, across * c + along * s
            else:
                _, arm[j], _ = evaluate_linkage(linkage[j], q[j])
            cosine[j], sine[j] = along, across
            length = add_extension(chain.slides, chain.length, q, j)
            tip[k, 0] += length * along
            tip[k, 1] += length * across
        compute_chain_gravity_torques(chain, q, cosine, sine, weight)
        if moves:
            motion = JointMotion(q, velocity[k], acceleration[k])
            compute_inertia_torques(chain, motion, cosine, sine, work, push)
        for j in range(n):
            speed[k, j] = arm[j] * velocity[k, j]
            force[k, j] = weight[j] / arm[j]
            if moves:
                inertia[k, j] = push[j] / arm[j]
    return speed, force, tip, inertia
