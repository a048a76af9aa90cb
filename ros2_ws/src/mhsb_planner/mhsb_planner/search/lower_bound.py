"""What every plan between two postures must at least take, whatever its path and modes.

Cylinder strokes add up to no less than the distance between start and goal, each litre costs at
least P_S, and leakage flows for as long as the motion must last:

    T_lb = max( max_j |ΔL_j| / V_max,j , Σ_j A_dir |ΔL_j| / (Q_MP − n q_leak) )
    E_lb = P_S [ Σ_j A_dir |ΔL_j| + n q_leak T_lb ]

Both hold step by step for the costs of `s2_step`, since boosted oil never costs less than P_S
there, and no valve leaks less than at P_S; so w₁ E_lb + w₂ T_lb is also a consistent estimate of
the cost that remains in the search.
"""

from __future__ import annotations

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_model.types import FloatArray, frozen
from mhsb_planner.search.s2_step import Circuit, Postures, circuit_of, describe

ENERGY_ALONE = frozen(np.array([1.0, 0.0]))
"""Weights of energy [1/J] and time [1/s] for a bound on the energy itself."""


@kernel(inline="always")
def least_cost(
    area: FloatArray,
    pace: FloatArray,
    shared_flow: float,
    leakage: float,
    other_oil: float,
    other_time: float,
    start: FloatArray,
    goal: FloatArray,
    volume_weight: float,
    time_weight: float,
) -> float:
    """Least cost from cylinder lengths start[n] to goal[n] [m].

    area, pace, shared_flow  see `s2_step.Circuit`
    leakage                  of all valves [m³/s]
    other_oil, other_time    see `s2_step.Circuit`
    volume_weight            w₁ P_S [1/m³]
    time_weight              w₂ [1/s]
    """
    duration = other_time
    volume = other_oil
    for j in range(len(start)):
        delta = goal[j] - start[j]
        d = 0 if delta > 0.0 else 1
        duration = max(duration, abs(delta) * pace[j, Mode.N, d])
        volume += area[j, d] * abs(delta)
    duration = max(duration, volume / shared_flow)
    return volume_weight * (volume + leakage * duration) + time_weight * duration


@kernel(borrows=True)
def least_cost_between(
    c: Circuit, start: FloatArray, goal: FloatArray, weight: FloatArray
) -> float:
    """The same with the weights float64[2 or more] of energy [1/J] and time [1/s]."""
    return least_cost(
        c.area,
        c.pace,
        c.shared_flow,
        len(start) * c.leakage_flow + c.idle_leakage,
        c.other_oil,
        c.other_time,
        start,
        goal,
        weight[0] * c.supply_pressure,
        weight[1],
    )


def with_others(c: Circuit, oil: float, time: float) -> Circuit:
    """The same for bounds that count what others take meanwhile: oil [m³], and least time [s]."""
    return c._replace(other_oil=oil, other_time=time)


@kernel
def least_costs_between(
    c: Circuit, start: FloatArray, goals: FloatArray, weight: FloatArray
) -> FloatArray:
    """The same to each of goals[goals, n] [m], float64[goals]."""
    least = np.empty(len(goals))
    for k in range(len(goals)):
        least[k] = least_cost_between(c, start, goals[k], weight)
    return least


def energy_lower_bound(machine: Machine, start: FloatArray, goals: FloatArray) -> float:
    """E_lb [J] from the posture start[n] to the cheapest of the postures goals[goals, n] [rad]."""
    arrays = machine.arrays
    one, many = (describe(arrays, np.atleast_2d(np.asarray(q, float))) for q in (start, goals))
    circuit = circuit_of(arrays, machine.patterns)
    return float(least_costs_between(circuit, one.length[0], many.length, ENERGY_ALONE).min())


def energy_bound_between(circuit: Circuit, start: Postures, goals: Postures) -> float:
    """The same from the only posture of `start` to the cheapest of `goals`, lengths known [J]."""
    return float(
        least_costs_between(circuit, start.length[0], goals.length, ENERGY_ALONE).min()
    )
