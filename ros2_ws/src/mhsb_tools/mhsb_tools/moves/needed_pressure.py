"""Forces that pistons exert during a motion, and the supply pressure that the motion needs."""

import numpy as np

from mhsb_model.circuit.elements import compute_friction_force
from mhsb_model.hydraulics import compute_required_pressures
from mhsb_model.machine import Machine
from mhsb_model.modes import RAIL_MODES
from mhsb_model.types import FloatArray, ModeArray
from mhsb_planner.motion.motion_profile import MotionProfile, compute_motion_profile

_compute_friction = np.vectorize(compute_friction_force, otypes=[float])


def compute_moving_forces(machine: Machine, profile: MotionProfile) -> FloatArray:
    """Compute the forces that the pistons exert during a motion.

        F = (M q̈ + C q̇ + g)/r + share · friction(v),  v = r q̇

    M q̈ + C q̇ + g are the joint torques by inertia, velocity and gravity, r the moment arms [m] and
    v the piston speeds [m/s]. The share is each actuator's own factor on the friction.

    Args:
        machine: The arm.
        profile: The motion, with the forces from inertia.

    Returns:
        Piston forces F [N], shape (k, n), positive if they extend the cylinder.
    """
    oil = machine.config.circuit
    friction = _compute_friction(
        oil.coulomb_friction, oil.viscous_friction, oil.friction_speed, profile.speed
    )
    return profile.force + profile.inertia + machine.friction_factors * friction


def compute_needed_pressure(
    machine: Machine, reference: FloatArray, modes: ModeArray
) -> FloatArray:
    """Compute the supply pressure that each actuator needs to follow a reference.

        p = max(P_S, p_req(F, 0), p_req(F, v))

    P_S is the main pump's pressure [Pa], F the piston force of `compute_moving_forces` [N] and v
    the piston speed [m/s]. p_req is the planner's law p_L + m(v) + margin: load pressure, pressure
    drop of the fully open valve, and boost margin [Pa]. Actuators in mode SB (fed by a common rail)
    get the highest p among them at each instant.

    Args:
        machine: The arm.
        reference: q [rad or m], q̇ [rad/s or m/s] and q̈ [rad/s² or m/s²] of n joints at k
            instants, shape (k, 3, n).
        modes: Modes in force, shape (k, n).

    Returns:
        Needed pressure p [Pa], shape (k, n).
    """
    profile = compute_motion_profile(machine, *np.moveaxis(reference, 1, 0))
    force = compute_moving_forces(machine, profile)
    need = np.maximum(
        machine.arrays.supply_pressure,
        compute_required_pressures(machine.arrays, force, np.zeros_like(force)),
    )
    need = np.maximum(need, compute_required_pressures(machine.arrays, force, profile.speed))
    on_rail = RAIL_MODES[modes]
    rail = np.max(need, axis=1, keepdims=True, where=on_rail, initial=0.0)
    return np.where(on_rail, rail, need)
