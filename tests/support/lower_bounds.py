"""Lower bound on the energy between postures, which tests compare with."""

from __future__ import annotations

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray, frozen
from mhsb_planner.search.lower_bound import ENERGY_ONLY_WEIGHTS, bound_costs_between
from mhsb_planner.search.s2_step import compute_hydraulic_coefficients


def energy_lower_bound(machine: Machine, start: FloatArray, goals: FloatArray) -> float:
    """Compute the least lower bound on the energy from a posture to one of several postures.

    Args:
        machine: Machine with its payload and hydraulics.
        start: Joint positions at the start, shape (n,) [rad or m].
        goals: Joint positions of the goal postures, shape (goals, n) [rad or m].

    Returns:
        Least lower bound over the goal postures [J]. No plan to any of them needs less energy.
    """
    lengths = frozen(np.array([machine.cylinder_lengths(q) for q in goals]))
    circuit = compute_hydraulic_coefficients(machine.arrays, machine.patterns)
    begin = machine.cylinder_lengths(start)
    return float(bound_costs_between(circuit, begin, lengths, ENERGY_ONLY_WEIGHTS).min())
