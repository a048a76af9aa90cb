"""Supply pressure that a motion itself needs, independent of the servo."""

from __future__ import annotations

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.circuit.elements import compute_friction_force
from mhsb_model.hydraulics import compute_required_pressure
from mhsb_model.kernels.kernel import kernel
from mhsb_model.linkages.linkage import moment_arm
from mhsb_model.machine import Machine
from mhsb_model.modes import RAIL_MODES
from mhsb_model.statics import MOTION_WORK, compute_motion_torques, get_chain
from mhsb_model.types import FloatArray, ModeArray


def compute_needed_pressure(
    machine: Machine, reference: FloatArray, modes: ModeArray
) -> FloatArray:
    """Compute the supply pressure that each actuator needs to follow a reference.

        p = max(P_S, p_hold, p_move)
        p_hold = p_req(F, 0),  p_move = p_req(F, v)
        F = (M q̈ + C q̇ + g)/r + friction(v),  v = r q̇

    P_S is the main pump's pressure [Pa], F the piston force [N], v the piston speed [m/s] and r the
    moment arm [m]. M q̈ + C q̇ + g are the joint torques by inertia, velocity and gravity. p_req is
    the planner's law p_L + m(v) + margin: load pressure, pressure drop of the fully open valve, and
    boost margin [Pa]. Actuators in mode SB (fed by a common rail) get the highest p among them at
    each instant.

    Args:
        machine: The arm.
        reference: q [rad or m], q̇ [rad/s or m/s] and q̈ [rad/s² or m/s²] of n joints at k
            instants, shape (k, 3, n).
        modes: Modes in force, shape (k, n).

    Returns:
        Needed pressure p [Pa], shape (k, n).
    """
    oil = machine.config.circuit
    return _needed_pressure(
        machine.arrays,
        np.array([oil.coulomb_friction, oil.viscous_friction, oil.friction_speed]),
        machine.friction_factors,
        reference,
        modes,
    )


@kernel
def _needed_pressure(
    m: MachineArrays,
    friction: FloatArray,
    share: FloatArray,
    reference: FloatArray,
    modes: ModeArray,
) -> FloatArray:
    """Compute the supply pressure that each actuator needs to follow a reference (kernel).

        p = max(P_S, p_hold, p_move)
        p_hold = p_req(F, 0),  p_move = p_req(F, v)
        F = (M q̈ + C q̇ + g)/r + share · friction(v),  v = r q̇

    P_S is the main pump's pressure [Pa], F the piston force [N], v the piston speed [m/s] and r the
    moment arm [m]. M q̈ + C q̇ + g are the joint torques by inertia, velocity and gravity. p_req is
    load pressure plus pressure drop of the fully open valve plus boost margin [Pa]. Actuators in
    mode SB (fed by a common rail) get the highest p among them at each instant.

    Args:
        m: The machine's arrays.
        friction: Coulomb friction [N], viscous friction [N s/m] and friction speed [m/s], shape
            (3,).
        share: Factor on each actuator's friction force, shape (n,) [-].
        reference: q [rad or m], q̇ [rad/s or m/s] and q̈ [rad/s² or m/s²] of n joints at k
            instants, shape (k, 3, n).
        modes: Modes in force, shape (k, n).

    Returns:
        Needed pressure p [Pa], shape (k, n).
    """
    rows, n = modes.shape
    need = np.empty((rows, n))
    chain = get_chain(m)
    work, weight, torque = np.empty((MOTION_WORK, n)), np.empty(n), np.empty(n)
    for k in range(rows):
        q, qd, qdd = reference[k, 0], reference[k, 1], reference[k, 2]
        compute_motion_torques(chain, q, qd, qdd, work, weight, torque)
        rail = 0.0
        for j in range(n):
            arm = moment_arm(m.linkage[j], q[j])
            speed = arm * qd[j]
            rubbing = compute_friction_force(friction[0], friction[1], friction[2], speed)
            force = torque[j] / arm + share[j] * rubbing
            held = compute_required_pressure(m, j, force, 0.0)
            moved = compute_required_pressure(m, j, force, speed)
            need[k, j] = max(m.supply_pressure, held, moved)
            if RAIL_MODES[modes[k, j]]:
                rail = max(rail, need[k, j])
        for j in range(n):
            if RAIL_MODES[modes[k, j]]:
                need[k, j] = rail
    return need
