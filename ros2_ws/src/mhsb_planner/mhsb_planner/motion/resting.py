"""Rests within a discrete path.

The ramps of a motion cut the path's corners. At a rest the motion reaches the posture exactly.
"""

from dataclasses import replace

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.types import IntArray
from mhsb_planner.motion.s3_ramps import compute_shortest_ramp
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_planner.search.s2_search import Weights


def insert_rests(
    machine: Machine, path: DiscretePath, step_indices: IntArray, weights: Weights | None = None
) -> DiscretePath:
    """Insert a rest before given steps of a discrete path.

    A rest is a step without motion, in the modes of the step that follows. Its duration T [s] is
    that of the shortest ramp (change of speed within acceleration and jerk limits) from V_max to
    rest. During a rest the n valves leak, which takes the energy

        E = P_S n q_leak T    [J]

    P_S is the main pump's pressure [Pa] and q_leak the leakage flow of one valve [m³/s].

    Args:
        machine: Machine with all its joints.
        path: The path; it stays unchanged.
        step_indices: Indices in `path` of the steps before which the arm rests.
        weights: Weights for adding energy and time of the rests to the path's cost. None leaves the
            cost as it is.

    Returns:
        Copy of the path with one more step for each rest.
    """
    m, seconds = machine.arrays, compute_shortest_ramp(machine).duration
    energy = m.supply_pressure * machine.joint_count * m.leakage_flow * seconds
    price = 0.0 if weights is None else weights.energy * energy + weights.time * seconds
    return replace(
        path,
        tip=np.insert(path.tip, step_indices, path.tip[step_indices], axis=0),
        posture=np.insert(path.posture, step_indices, path.posture[step_indices], axis=0),
        modes=np.insert(path.modes, step_indices, path.modes[step_indices], axis=0),
        duration=np.insert(path.duration, step_indices, seconds),
        energy=np.insert(path.energy, step_indices, energy),
        energy_series=np.insert(path.energy_series, step_indices, energy),
        cost=path.cost + len(step_indices) * price,
    )
