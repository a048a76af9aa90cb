"""How fast the arm swings on the oil in its cylinders: the measure for the servo's gains."""

from __future__ import annotations

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray
from mhsb_sim.circuit.constants import cylinders_of

POSTURES = 256
SEED = 0


def oil_stiffness(machine: Machine, q: FloatArray) -> FloatArray:
    """k_h = β (A²/V_A + a²/V_B) of each cylinder at q [rad], float64[n] N/m.

    β the bulk modulus, V the oil on each side of the piston, dead volume included. Source:
    H. E. Merritt, Hydraulic Control Systems.
    """
    arrays, oil = machine.arrays, machine.config.circuit
    own, length = cylinders_of(machine), machine.cylinder_lengths(q)
    dead, cap, rod = own["dead_volume"], own["cap_area"], own["rod_area"]
    cap_volume = dead + own["swept"] * cap * (length - own["min_length"])
    rod_volume = dead + own["swept"] * rod * (own["max_length"] - length)
    return oil.bulk_modulus * (arrays.cap_area**2 / cap_volume + arrays.rod_area**2 / rod_volume)


def joint_frequencies(machine: Machine, q: FloatArray) -> FloatArray:
    """ω_j = |r_j| √(k_h,j / M_jj) of each joint at q [rad], all others locked, float64[n] rad/s.

    With moment arms r, oil stiffness k_h and mass matrix M, payload included.
    """
    stiffness = machine.moment_arms(q) ** 2 * oil_stiffness(machine, q)
    return np.sqrt(stiffness / np.diag(machine.mass_matrix(q)))


def lowest_joint_frequencies(machine: Machine) -> FloatArray:
    """The lowest of each joint [rad/s], of postures spread evenly over the joints' ranges."""
    arrays = machine.arrays
    postures = np.random.default_rng(SEED).uniform(
        arrays.joint_min, arrays.joint_max, (POSTURES, machine.joint_count)
    )
    return np.array(np.min([joint_frequencies(machine, q) for q in postures], axis=0))
