"""What a joint motion asks of the actuators: piston speeds, static forces and the tip's path."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from mhsb_model.arrays import MachineArrays
from mhsb_model.linkages.linkage import motion
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray, frozen


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


def motion_profile(
    machine: Machine,
    position: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray | None = None,
) -> MotionProfile:
    """Profile of states, float64[k, n] each: q [rad], q̇ [rad/s], and q̈ [rad/s²] if inertia counts.

    Source: recursive Newton–Euler, R. Featherstone, Rigid Body Dynamics Algorithms, 5.3.
    """
    qdd = np.empty((0, position.shape[1])) if acceleration is None else acceleration
    return MotionProfile(
        *_profile(machine.arrays, frozen(position), frozen(velocity), frozen(qdd))
    )


@njit(cache=True, nogil=True)
def _profile(
    m: MachineArrays, position: FloatArray, velocity: FloatArray, acceleration: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Kernel of `motion_profile`; its oracle in the tests is the Machine's own methods.

    Statics, dynamics, arms and the tip share what they have in common. Arrays are taken by rows
    and columns: views of rows and tuples handed on would take longer than the rest.
    """
    rows, n = position.shape
    speed, force, tip = np.empty((rows, n)), np.empty((rows, n)), np.zeros((rows, 2))
    inertia = np.zeros((rows, n))
    length, mass_of, center, linkage = m.link_length, m.link_mass, m.link_center, m.linkage
    link_inertia = m.link_inertia
    cosine, sine = np.empty(n), np.empty(n)
    turn, thrust_x, thrust_z = np.empty(n), np.empty(n), np.empty(n)
    for k in range(rows):
        angle = 0.0
        for j in range(n):
            angle += position[k, j]
            cosine[j], sine[j] = math.cos(angle), math.sin(angle)
            tip[k, 0] += length[j] * cosine[j]
            tip[k, 1] += length[j] * sine[j]
        moves = len(acceleration) > 0
        push_x = push_z = push = 0.0
        if moves:
            omega = alpha = ax = az = 0.0
            for j in range(n):
                omega += velocity[k, j]
                alpha += acceleration[k, j]
                inwards = omega * omega
                gx = -inwards * cosine[j] - alpha * sine[j]
                gz = -inwards * sine[j] + alpha * cosine[j]
                turn[j] = link_inertia[j] * alpha
                thrust_x[j] = mass_of[j] * (ax + gx * center[j])
                thrust_z[j] = mass_of[j] * (az + gz * center[j])
                ax += gx * length[j]
                az += gz * length[j]
            push_x, push_z = m.payload * ax, m.payload * az
        moment, mass = 0.0, m.payload
        for j in range(n - 1, -1, -1):
            moment += cosine[j] * (mass_of[j] * center[j] + mass * length[j])
            mass += mass_of[j]
            _, arm, _ = motion(linkage[j], position[k, j])
            speed[k, j] = arm * velocity[k, j]
            force[k, j] = m.gravity * moment / arm
            if moves:
                push += turn[j] + length[j] * (cosine[j] * push_z - sine[j] * push_x)
                push += center[j] * (cosine[j] * thrust_z[j] - sine[j] * thrust_x[j])
                push_x += thrust_x[j]
                push_z += thrust_z[j]
                inertia[k, j] = push / arm
    return speed, force, tip, inertia
