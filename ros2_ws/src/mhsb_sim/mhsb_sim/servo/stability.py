"""Whether the cascade is stable: its linear loop in postures all over the workspace."""

from __future__ import annotations

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.schema import CascadeGains
from mhsb_model.types import FloatArray
from mhsb_sim.records import Records
from mhsb_sim.servo.cascade import axis_records
from mhsb_sim.servo.natural_frequency import oil_stiffness

POSTURES = 200
SEED = 1


def closed_loop(axes: Records, loaded: Machine, q: FloatArray) -> FloatArray:
    """Matrix of the cascade on a machine at q [rad], linear and with ideal valves and supply.

    States: errors e of the cylinder lengths, ė, excess forces f, biases d, integrals w:
    R⁻¹ M R⁻¹ ë = −f, ḟ = k_h (ė + w) + ω_F (d + k_p k_h/ω_F e − f), τ ḋ = f − d, ẇ = k_i e.
    """
    inverse_arms = np.diag(1.0 / loaded.moment_arms(q))
    mass = inverse_arms @ loaded.mass_matrix(q) @ inverse_arms
    oil = np.diag(oil_stiffness(loaded, q))
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


def slowest_decay(machine: Machine, gains: CascadeGains, payload: float) -> float:
    """−Re λ of the loop's slowest mode [1/s] under a payload [kg], the least of many postures.

    Negative where a swing grows. The servo goes by the machine's own payload.
    """
    axes, loaded = axis_records(machine, gains), machine.changed(payload=payload)
    limits = machine.arrays.joint_min, machine.arrays.joint_max
    postures = np.random.default_rng(SEED).uniform(*limits, (POSTURES, machine.joint_count))
    return -max(
        float(np.linalg.eigvals(closed_loop(axes, loaded, q)).real.max()) for q in postures
    )
