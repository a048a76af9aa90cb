"""Forces that the pistons exert during a motion."""

from __future__ import annotations

import numpy as np

from mhsb_model.circuit.elements import compute_friction_force
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray
from mhsb_planner.motion.motion_profile import MotionProfile

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
