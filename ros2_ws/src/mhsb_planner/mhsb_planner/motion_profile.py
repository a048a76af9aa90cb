"""What a joint motion asks of the actuators: piston speeds, static forces and the tip's path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from mhsb_model.arrays import MachineArrays
from mhsb_model.kinematics import tip_position
from mhsb_model.linkage import moment_arm
from mhsb_model.machine import Machine
from mhsb_model.statics import piston_forces
from mhsb_model.types import FloatArray, frozen


@dataclass(frozen=True, eq=False)
class MotionProfile:
    """Quantities along a motion, one row for each instant.

    speed  float64[k, n] m/s, v = r(q) q̇ of the pistons, positive extending
    force  float64[k, n] N, F = τ_g(q)/r(q) under gravity, positive resists extension
    tip    float64[k, 2] m, (x, z)
    """

    speed: FloatArray
    force: FloatArray
    tip: FloatArray

    def since(self, row: int) -> MotionProfile:
        """The profile from one instant on."""
        return MotionProfile(self.speed[row:], self.force[row:], self.tip[row:])


def motion_profile(machine: Machine, position: FloatArray, velocity: FloatArray) -> MotionProfile:
    """Profile of the states with `position` [rad] and `velocity` [rad/s], float64[k, n] each."""
    return MotionProfile(*_profile(machine.arrays, frozen(position), frozen(velocity)))


@njit(cache=True, nogil=True)
def _profile(
    m: MachineArrays, position: FloatArray, velocity: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Kernel of `motion_profile`; its oracle in the tests is the Machine's own methods."""
    rows, n = position.shape
    speed = np.empty((rows, n))
    force = np.empty((rows, n))
    tip = np.empty((rows, 2))
    for k in range(rows):
        q = position[k]
        piston_forces(m, q, force[k])
        tip[k] = tip_position(m.link_length, q)
        for j in range(n):
            speed[k, j] = moment_arm(m.linkage[j], q[j]) * velocity[k, j]
    return speed, force, tip
