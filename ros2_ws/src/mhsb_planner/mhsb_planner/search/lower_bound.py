"""Lower bounds on the cost of every plan between two postures, for any path and any modes.

The strokes of cylinder j add up to at least the difference |ΔL_j| of its lengths at start and goal.
Oil costs at least P_S per volume, and leakage flows for the whole motion:

    T_lb = max( max_j |ΔL_j| / V_max,j , Σ_j A_dir |ΔL_j| / (Q_MP − n q_leak) )
    E_lb = P_S [ Σ_j A_dir |ΔL_j| + n q_leak T_lb ]

P_S [Pa] is the main pump's pressure and Q_MP [m³/s] its flow. A_dir [m²] is the piston area that
fills, and q_leak [m³/s] the leakage of one of the n valves at P_S.

Both bounds hold for each step at the costs of `s2_step`: there boosted oil never costs less than
P_S, and no valve leaks less than at P_S. Hence w₁ E_lb + w₂ T_lb is a consistent heuristic for the
search.
"""

import math

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.modes import Mode
from mhsb_model.types import FloatArray, frozen
from mhsb_planner.search.s2_step import (
    HydraulicCoefficients,
)

ENERGY_ONLY_WEIGHTS = frozen(np.array([1.0, 0.0]))
"""Weights of energy [1/J] and time [1/s] that make a lower bound on the cost a bound on the energy
[J].
"""


@kernel(borrows=True, reads=True)
def bound_cost_between(
    c: HydraulicCoefficients, start: FloatArray, goal: FloatArray, weight: FloatArray
) -> float:
    """Compute a lower bound on the weighted cost between two sets of cylinder lengths.

        V = other_oil + Σ_j A_j |ΔL_j|
        T_lb = max( other_time, max_j |ΔL_j| / V_max,j, V / shared_flow )
        cost = w₁ P_S (V + leakage · T_lb) + w₂ T_lb

    V [m³] is the oil that the pistons take, and T_lb [s] a lower bound on the duration. Cylinder j
    changes its length by ΔL_j [m] and its speed limit in mode N is V_max,j [m/s]. A_j is the piston
    area that fills in this direction [m²]. The main pump has the supply pressure P_S [Pa] and the
    flow `shared_flow` [m³/s] for the pistons. `leakage` [m³/s] is the leakage flow of all valves at
    P_S. `other_oil` and `other_time` are the needs of other motions, such as a slew. Mode switches
    do not count.

    Args:
        c: Hydraulic coefficients of the machine: areas, speed limits, flows, P_S, `other_oil` [m³]
            and `other_time` [s].
        start: Cylinder lengths at the start, shape (n,) [m].
        goal: Cylinder lengths at the goal, shape (n,) [m].
        weight: Weights w₁ of energy [1/J] and w₂ of time [1/s]. Further entries are ignored.

    Returns:
        Lower bound on w₁ E + w₂ T, with the energy E and the duration T of any plan [-].
    """
    duration, volume = c.other_time, c.other_oil
    for j in range(len(start)):
        delta = goal[j] - start[j]
        d = 0 if delta > 0.0 else 1
        duration = max(duration, abs(delta) * c.inverse_speed_limit[j, Mode.N, d])
        volume += c.area[j, d] * abs(delta)
    duration = max(duration, volume / c.shared_flow)
    leakage = len(start) * c.leakage_flow + c.idle_leakage
    return weight[0] * c.supply_pressure * (volume + leakage * duration) + weight[1] * duration


@kernel(borrows=True)
def bound_cost_to_nearest(
    c: HydraulicCoefficients, start: FloatArray, goals: FloatArray, weight: FloatArray
) -> float:
    """Compute the least of the lower bounds on the weighted cost to several goals.

    Args:
        c: Hydraulic coefficients of the machine (areas, speed limits, flows, supply pressure). Its
            `other_oil` and `other_time` (needs of other motions, such as a slew) are included.
        start: Cylinder lengths at the start, shape (n,) [m].
        goals: Cylinder lengths at the goals, shape (goals, n) [m].
        weight: Weights w₁ of energy [1/J] and w₂ of time [1/s]. Further entries are ignored.

    Returns:
        Least of the lower bounds on w₁ · energy + w₂ · time over the goals [-]; inf if there is no
        goal.
    """
    least = math.inf
    for k in range(len(goals)):
        least = min(least, bound_cost_between(c, start, goals[k], weight))
    return least


@kernel
def bound_costs_between(
    c: HydraulicCoefficients, start: FloatArray, goals: FloatArray, weight: FloatArray
) -> FloatArray:
    """Compute one lower bound on the weighted cost for each of several goals.

    Args:
        c: Hydraulic coefficients of the machine (areas, speed limits, flows, supply pressure). Its
            `other_oil` and `other_time` (needs of other motions, such as a slew) are included.
        start: Cylinder lengths at the start, shape (n,) [m].
        goals: Cylinder lengths at the goals, shape (goals, n) [m].
        weight: Weights w₁ of energy [1/J] and w₂ of time [1/s]. Further entries are ignored.

    Returns:
        Lower bounds on w₁ · energy + w₂ · time, shape (goals,), aligned with `goals` [-].
    """
    least = np.empty(len(goals))
    for k in range(len(goals)):
        least[k] = bound_cost_between(c, start, goals[k], weight)
    return least
