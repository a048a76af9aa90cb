"""Inverse dynamics of the planar chain, for the servo's feed-forward."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray
from mhsb_sim.records import Records

LINK = np.dtype([("length", "f8"), ("mass", "f8"), ("center", "f8"), ("inertia", "f8")])

SCRATCH_WIDTH = 5


def link_records(machine: Machine) -> Records:
    """Links of a machine, LINK[n + 1]: the last one is the payload, a point mass."""
    arrays = machine.arrays
    links = np.zeros(machine.joint_count + 1, LINK)
    links["length"][:-1] = arrays.link_length
    links["mass"][:-1] = arrays.link_mass
    links["center"][:-1] = arrays.link_center
    links["inertia"][:-1] = arrays.link_inertia
    links["mass"][-1] = arrays.payload
    return links


@njit(cache=True, nogil=True)
def inverse_dynamics(
    links: Records,
    gravity: float,
    q: FloatArray,
    qd: FloatArray,
    qdd: FloatArray,
    scratch: FloatArray,
    torque: FloatArray,
) -> None:
    """τ = M(q) q̈ + C(q, q̇) q̇ + g(q), written to torque[n] [N m].

    links: LINK[n + 1], the last the payload; gravity [m/s²]; q, q̇, q̈ float64[n];
    scratch float64[n, SCRATCH_WIDTH]. Outwards, each link's accelerations, gravity being an
    upward acceleration of the base; inwards, the force and moment it passes on.
    Source: recursive Newton–Euler, R. Featherstone, Rigid Body Dynamics Algorithms, 5.3.
    Oracle: MuJoCo's qfrc_inverse (test/mechanics/test_inverse_dynamics.py).
    """
    n = len(q)
    angle, omega, alpha = 0.0, 0.0, 0.0
    ax, az = 0.0, gravity
    for i in range(n):
        angle += q[i]
        omega += qd[i]
        alpha += qdd[i]
        cosine, sine = math.cos(angle), math.sin(angle)
        along = -omega * omega
        gx, gz = along * cosine - alpha * sine, along * sine + alpha * cosine
        scratch[i, 0] = cosine
        scratch[i, 1] = sine
        scratch[i, 2] = ax + gx * links[i].center
        scratch[i, 3] = az + gz * links[i].center
        scratch[i, 4] = alpha
        ax += gx * links[i].length
        az += gz * links[i].length
    fx, fz, moment = links[n].mass * ax, links[n].mass * az, 0.0
    for i in range(n - 1, -1, -1):
        cosine, sine = scratch[i, 0], scratch[i, 1]
        own_x, own_z = links[i].mass * scratch[i, 2], links[i].mass * scratch[i, 3]
        moment += links[i].inertia * scratch[i, 4]
        moment += links[i].length * (cosine * fz - sine * fx)
        moment += links[i].center * (cosine * own_z - sine * own_x)
        fx += own_x
        fz += own_z
        torque[i] = moment


@njit(cache=True, nogil=True)
def gravity_torques(
    links: Records, gravity: float, scratch: FloatArray, torque: FloatArray
) -> None:
    """τ = g(q) of the posture that `inverse_dynamics` has just left in scratch, to torque[n] [N m].

    Inwards, each joint carries the weights beyond it: τᵢ = τᵢ₊₁ + cos φᵢ (lᵢ W + cᵢ wᵢ), with W
    the weight beyond link i and φᵢ its angle to the horizontal.
    """
    weight, moment = gravity * links[len(torque)].mass, 0.0
    for i in range(len(torque) - 1, -1, -1):
        own = gravity * links[i].mass
        moment += scratch[i, 0] * (links[i].length * weight + links[i].center * own)
        weight += own
        torque[i] = moment
