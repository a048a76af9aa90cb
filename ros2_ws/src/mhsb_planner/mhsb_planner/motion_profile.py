"""What a joint motion asks of the actuators: piston speeds, static forces and the tip's path."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from mhsb_model.arrays import MachineArrays
from mhsb_model.linkage import motion
from mhsb_model.machine import Machine
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

    def __getitem__(self, rows: slice) -> MotionProfile:
        """The profile of some of the instants."""
        return MotionProfile(self.speed[rows], self.force[rows], self.tip[rows])


def motion_profile(machine: Machine, position: FloatArray, velocity: FloatArray) -> MotionProfile:
    """Profile of the states with `position` [rad] and `velocity` [rad/s], float64[k, n] each."""
    return MotionProfile(*_profile(machine.arrays, frozen(position), frozen(velocity)))


@njit(cache=True, nogil=True)
def _profile(
    m: MachineArrays, position: FloatArray, velocity: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Kernel of `motion_profile`; its oracle in the tests is the Machine's own methods.

    Statics, arms and the tip share what they have in common. Arrays are taken by rows and
    columns: views of rows and tuples handed on would take longer than the rest.
    """
    rows, n = position.shape
    speed, force, tip = np.empty((rows, n)), np.empty((rows, n)), np.zeros((rows, 2))
    length, mass_of, center, linkage = m.link_length, m.link_mass, m.link_center, m.linkage
    for k in range(rows):
        angle = 0.0
        for j in range(n):
            angle += position[k, j]
            cosine = math.cos(angle)
            tip[k, 0] += length[j] * cosine
            tip[k, 1] += length[j] * math.sin(angle)
            force[k, j] = cosine
        moment, mass = 0.0, m.payload
        for j in range(n - 1, -1, -1):
            moment += force[k, j] * (mass_of[j] * center[j] + mass * length[j])
            mass += mass_of[j]
            _, arm, _ = motion(linkage[j], position[k, j])
            speed[k, j] = arm * velocity[k, j]
            force[k, j] = m.gravity * moment / arm
    return speed, force, tip
