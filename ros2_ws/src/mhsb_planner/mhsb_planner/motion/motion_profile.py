"""What a joint motion asks of the actuators: piston speeds, static forces and the tip's path."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.kinematics import extended
from mhsb_model.linkages.linkage import motion, motion_at
from mhsb_model.machine import Machine
from mhsb_model.statics import INERTIA_WORK, chain_of, gravity_torques, inertia_torques
from mhsb_model.types import FloatArray, ModeArray, as_frozen


@dataclass(frozen=True, eq=False)
class MotionProfile:
    """Quantities along a motion, one row for each instant.

    speed    float64[k, n] m/s, v = r(q) q̇ of the pistons, positive extending
    force    float64[k, n] N, F = τ_g(q)/r(q) under gravity, positive resists extension
    tip      float64[k, 2] m, (x, z)
    inertia  float64[k, n] N, (M q̈ + C q̇)/r that comes on top of F, 0 where q̈ is not looked at
    """

    speed: FloatArray
    force: FloatArray
    tip: FloatArray
    inertia: FloatArray

    def __getitem__(self, rows: slice) -> MotionProfile:
        """The profile of some of the instants."""
        return MotionProfile(
            self.speed[rows], self.force[rows], self.tip[rows], self.inertia[rows]
        )


class Profiles(NamedTuple):
    """Profiles of a motion at k instants, and half-way between each of them and the next.

    modes  uint8[k - 1, n], in force between the instants
    """

    points: MotionProfile
    middles: MotionProfile
    modes: ModeArray


def motion_profile(
    machine: Machine,
    position: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray | None = None,
) -> MotionProfile:
    """Profile of states, float64[k, n]: q [rad], q̇ [rad/s], and q̈ [rad/s²] where inertia counts."""
    qdd = np.empty((0, position.shape[1])) if acceleration is None else acceleration
    return MotionProfile(
        *profile_of(machine.arrays, as_frozen(position), as_frozen(velocity), as_frozen(qdd))
    )


@kernel
def profile_of(
    m: MachineArrays, position: FloatArray, velocity: FloatArray, acceleration: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Kernel of `motion_profile`; its oracle in the tests is the Machine's own methods."""
    rows, n = position.shape
    speed, force, tip = np.empty((rows, n)), np.empty((rows, n)), np.zeros((rows, 2))
    inertia = np.zeros((rows, n))
    chain, linkage, moves = chain_of(m), m.linkage, len(acceleration) > 0
    cosine, sine = np.empty(n), np.empty(n)
    arm, weight, push, work = np.empty(n), np.empty(n), np.zeros(n), np.empty((INERTIA_WORK, n))
    for k in range(rows):
        along, across = 1.0, 0.0  # cosine and sine of the link before
        q = position[k]
        for j in range(n):
            if chain.turns[j]:
                c, s = math.cos(q[j]), math.sin(q[j])
                _, arm[j], _ = motion_at(linkage[j], c, s)
                along, across = along * c - across * s, across * c + along * s
            else:
                _, arm[j], _ = motion(linkage[j], q[j])
            cosine[j], sine[j] = along, across
            length = extended(chain.slides, chain.length, q, j)
            tip[k, 0] += length * along
            tip[k, 1] += length * across
        gravity_torques(chain, q, cosine, sine, weight)
        if moves:
            inertia_torques(chain, q, cosine, sine, velocity[k], acceleration[k], work, push)
        for j in range(n):
            speed[k, j] = arm[j] * velocity[k, j]
            force[k, j] = weight[j] / arm[j]
            if moves:
                inertia[k, j] = push[j] / arm[j]
    return speed, force, tip, inertia
