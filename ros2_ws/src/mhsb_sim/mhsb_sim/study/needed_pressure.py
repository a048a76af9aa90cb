"""Supply pressure that a motion itself needs, whatever the servo makes of it."""

from __future__ import annotations

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.hydraulics import required_pressure
from mhsb_model.kernels.kernel import kernel
from mhsb_model.linkages.linkage import moment_arm
from mhsb_model.machine import Machine
from mhsb_model.modes import ON_RAIL
from mhsb_model.statics import MOTION_WORK, chain_of, moving_torques
from mhsb_model.types import FloatArray, ModeArray
from mhsb_sim.circuit.elements import friction_force


def needed_pressure(
    machine: Machine, reference: FloatArray, modes: ModeArray
) -> FloatArray:
    """Supply pressure that each actuator's reference needs, float64[k, n] Pa.

    reference  float64[k, 3, n]: q [rad], q̇ [rad/s], q̈ [rad/s²]
    modes      uint8[k, n]

    p = max(P_S, p_hold, p_move): to hold the load still and to move it at the reference's speed,
    each by the planner's law p_L + m(v) + margin (`mhsb_model.hydraulics.required_pressure`), with
    the force of statics, dynamics and friction, F = (M q̈ + C q̇ + g)/r + friction(v). The hold
    counts whichever way the load moves, since it has to be carried at every reversal. Actuators
    in SB share one rail and so need what the neediest of them does.
    """
    oil = machine.config.circuit
    return _needed_pressure(
        machine.arrays,
        np.array([oil.coulomb_friction, oil.viscous_friction, oil.friction_speed]),
        machine.frictions,
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
    rows, n = modes.shape
    need = np.empty((rows, n))
    chain = chain_of(m)
    work, weight, torque = np.empty((MOTION_WORK, n)), np.empty(n), np.empty(n)
    for k in range(rows):
        q, qd, qdd = reference[k, 0], reference[k, 1], reference[k, 2]
        moving_torques(chain, q, qd, qdd, work, weight, torque)
        rail = 0.0
        for j in range(n):
            arm = moment_arm(m.linkage[j], q[j])
            speed = arm * qd[j]
            rubbing = friction_force(friction[0], friction[1], friction[2], speed)
            force = torque[j] / arm + share[j] * rubbing
            held = required_pressure(m, j, force, 0.0)
            moved = required_pressure(m, j, force, speed)
            need[k, j] = max(m.supply_pressure, held, moved)
            if ON_RAIL[modes[k, j]]:
                rail = max(rail, need[k, j])
        for j in range(n):
            if ON_RAIL[modes[k, j]]:
                need[k, j] = rail
    return need
