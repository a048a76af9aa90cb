"""Strokes, torques and rates of a machine: the units of tuned numbers without dimension."""

import numpy as np

from mhsb_control.natural_frequency import draw_postures
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray


def compute_angle_strokes(machine: Machine) -> FloatArray:
    """Compute the largest stroke of each piston per radian of its joint, over random postures.

    Args:
        machine: The machine as its file describes it.

    Returns:
        Largest stroke per radian (moment arm), float64[n], [m/rad]. For a sliding joint, it is the
        travel that counts as one radian.
    """
    arms = np.array([machine.moment_arms(q) for q in draw_postures(machine)])
    return np.abs(arms).max(axis=0) * machine.radian_equivalents


def compute_supply_torques(machine: Machine) -> FloatArray:
    """Compute the largest torque that each cylinder can give at the main pump's pressure.

    Args:
        machine: The machine as its file describes it.

    Returns:
        P_S A max |r|, with the cap-side area A and the moment arm r, float64[n], [N m]. For a
        sliding joint, max |r| is the travel that counts as one radian.
    """
    arrays = machine.arrays
    return arrays.supply_pressure * arrays.cap_area * compute_angle_strokes(machine)


def compute_braking_rate(machine: Machine) -> float:
    """Compute the rate at which the main pump's pressure would brake the slowest joint.

    A piston at the speed V_max is braked by the main pump's pressure P_S in its return chamber, on
    the rod-side area a. All other joints are at rest:

        rate = min (P_S a r²/(M_jj V_max))

    r is the moment arm [m] and M_jj the joint's inertia [kg m²]. The minimum is taken over all
    joints and over random postures. Gravity is neglected.

    Args:
        machine: The machine as its file describes it.

    Returns:
        Smallest ratio of deceleration to speed of all joints and postures [1/s].
    """
    arrays = machine.arrays
    force = arrays.supply_pressure * arrays.rod_area
    decelerations = [
        force * machine.moment_arms(q) ** 2 / np.diag(machine.mass_matrix(q))
        for q in draw_postures(machine)
    ]
    return float(np.min(np.array(decelerations) / arrays.max_piston_speed))
