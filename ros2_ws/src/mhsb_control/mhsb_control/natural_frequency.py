"""Natural frequencies of the arm on the oil in its cylinders. The gains are computed from them."""

import numpy as np

from mhsb_model.circuit.constants import build_cylinders
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray

POSTURE_SAMPLES = 256
"""Number of random postures over which the lowest frequency is searched."""
SAMPLING_SEED = 0
"""Seed of the random postures."""


def compute_oil_stiffness(machine: Machine, q: FloatArray) -> FloatArray:
    """Compute the stiffness of the oil in each cylinder at one posture or several.

        k_h = β (A²/V_A + a²/V_B)

    β is the bulk modulus of the oil [Pa]. A and a are the piston areas on the cap side and the rod
    side. V_A and V_B are the oil volumes of both sides, dead volumes included [m³].

    Args:
        machine: The machine as declared in its file (the real one may differ).
        q: Joint positions, float64[..., n], [rad or m].

    Returns:
        Stiffness k_h, of the shape of q, [N/m].

    Source:
        H. E. Merritt, Hydraulic Control Systems.
    """
    arrays, oil = machine.arrays, machine.config.circuit
    own, length = build_cylinders(machine), np.apply_along_axis(machine.cylinder_lengths, -1, q)
    dead, cap, rod = own["dead_volume"], own["cap_area"], own["rod_area"]
    cap_volume = dead + own["swept_volume_factor"] * cap * (length - own["min_length"])
    rod_volume = dead + own["swept_volume_factor"] * rod * (own["max_length"] - length)
    return oil.bulk_modulus * (arrays.cap_area**2 / cap_volume + arrays.rod_area**2 / rod_volume)


def compute_joint_frequencies(machine: Machine, q: FloatArray) -> FloatArray:
    """Compute the natural frequency of each joint at each posture, with all other joints locked.

        ω_j = |r_j| √(k_h,j / M_jj)

    r is the moment arm [m], k_h the stiffness of the oil [N/m], and M the mass matrix with payload.
    For a prismatic joint, r is dimensionless and M_jj a mass [kg].

    Args:
        machine: The machine as declared in its file (the real one may differ).
        q: Joint positions, float64[..., n], [rad or m].

    Returns:
        Natural frequencies, of the shape of q, [rad/s].
    """
    arms = np.apply_along_axis(machine.moment_arms, -1, q)
    masses = np.apply_along_axis(lambda each: np.diag(machine.mass_matrix(each)), -1, q)
    return np.sqrt(arms**2 * compute_oil_stiffness(machine, q) / masses)


def draw_postures(machine: Machine) -> FloatArray:
    """Draw POSTURE_SAMPLES postures uniformly from the joint ranges, always with the same seed.

    Args:
        machine: The machine as its file describes it.

    Returns:
        Joint positions, float64[POSTURE_SAMPLES, n], [rad or m].
    """
    arrays = machine.arrays
    return np.random.default_rng(SAMPLING_SEED).uniform(
        arrays.joint_min, arrays.joint_max, (POSTURE_SAMPLES, machine.joint_count)
    )


def find_joint_frequency_ranges(machine: Machine) -> tuple[FloatArray, FloatArray]:
    """Find the lowest and the highest natural frequency of each joint over random postures.

    In each posture a joint oscillates on the oil of its cylinder, with all other joints locked.
    `draw_postures` draws the postures.

    Args:
        machine: The machine as declared in its file (the real one may differ).

    Returns:
        Lowest and highest natural frequencies, float64[n] each, [rad/s]. Values of different joints
        may belong to different postures.
    """
    found = compute_joint_frequencies(machine, draw_postures(machine))
    return found.min(axis=0), found.max(axis=0)
