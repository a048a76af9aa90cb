"""Stability of the cascade: decay of its linear control loop in random postures."""

import numpy as np

from mhsb_control.cascade import CascadeGains, ControlAxis, build_axis_records
from mhsb_control.natural_frequency import compute_oil_stiffness
from mhsb_model.machine import Machine
from mhsb_model.records import Records
from mhsb_model.types import FloatArray

POSTURE_SAMPLES = 200
"""Number of random postures in which the loop is examined."""
SAMPLING_SEED = 1
"""Seed of the random postures."""

SLOWEST_DECAY = 0.0128
"""Smallest decay rate of the linear loop, divided by the lowest natural frequency of the arm.

It is required in every posture with every payload. For the suite's own arm it is 0.3 1/s."""


def build_closed_loop_matrix(
    axes: Records[ControlAxis], loaded: Machine, q: FloatArray
) -> FloatArray:
    """Build the linear system matrix of the cascade at a posture, with ideal valves and supply.

    The states of each cylinder are its length error e, the rate ė, the excess force f, the bias d
    and the integral w. f is the cylinder force minus the force that the reference needs. d is the
    control loop's slow estimate of f. w is the integral part of the position loop:

        R⁻¹ M R⁻¹ ë = −f
        ḟ = k_h (ė + w) + ω_F (d + (k_p k_h/ω_F) e − f)
        τ ḋ = f − d
        ẇ = k_i e

    R is the diagonal matrix of the moment arms, M the mass matrix, and k_h the stiffness of the oil
    in each cylinder [N/m]. k_p, ω_F, τ and k_i are the gains of the axes.

    Args:
        axes: ControlAxis[n] with the gains `position_gain` (k_p), `force_bandwidth` (ω_F),
            `bias_time` (τ) and `integral_gain` (k_i).
        loaded: Machine with the actual payload.
        q: Joint positions, float64[n], [rad or m].

    Returns:
        Square matrix for the states (e, ė, f, d, w), n each. The state w of an axis with k_i = 0 is
        left out.
    """
    inverse_arms = np.diag(1.0 / loaded.moment_arms(q))
    mass = inverse_arms @ loaded.mass_matrix(q) @ inverse_arms
    oil = np.diag(compute_oil_stiffness(loaded, q))
    names = ("position_gain", "force_bandwidth", "bias_time", "integral_gain")
    position, force, bias, integral = (np.diag(axes[name]) for name in names)
    forget = np.linalg.inv(bias)
    one, none = np.eye(len(q)), np.zeros((len(q), len(q)))
    loop = np.block(
        [
            [none, one, none, none, none],
            [none, none, -np.linalg.inv(mass), none, none],
            [position @ oil, oil, -force, force, oil],
            [none, none, forget, -forget, none],
            [integral, none, none, none, none],
        ]
    )
    there = np.concatenate([np.ones(4 * len(q), dtype=bool), axes["integral_gain"] > 0.0])
    return np.asarray(loop[np.ix_(there, there)])


def compute_slowest_decay(machine: Machine, gains: CascadeGains, payload: float) -> float:
    """Compute the slowest decay of the linear control loop over random postures.

    POSTURE_SAMPLES postures are drawn uniformly from the joint ranges, always with the same seed.
    The controller's gains are set for the payload of the machine file, whereas the arm has the
    actual payload.

    Args:
        machine: The machine as declared in its file (the real one may differ).
        gains: Gains of the controller, relative to natural frequencies.
        payload: Actual payload [kg].

    Returns:
        Smallest −Re λ of all eigenvalues λ in all postures [1/s]; negative if the loop is unstable
        in a posture.
    """
    axes, loaded = build_axis_records(machine, gains), machine.changed(payload=payload)
    limits = machine.arrays.joint_min, machine.arrays.joint_max
    postures = np.random.default_rng(SAMPLING_SEED).uniform(
        *limits, (POSTURE_SAMPLES, machine.joint_count)
    )
    return -max(
        float(np.linalg.eigvals(build_closed_loop_matrix(axes, loaded, q)).real.max())
        for q in postures
    )
