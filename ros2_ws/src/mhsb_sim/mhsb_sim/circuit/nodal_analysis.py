"""Nodal analysis: flows between pressure nodes are stamped into one linear system per step.

Linearly implicit Euler of C dp/dt = Q(p): (C/dt + G) Δp = Q(p), with G = −∂Q/∂p put together
from each element's own slope. G is symmetric and, with C/dt, positive definite.
Source: C.-W. Ho, A. Ruehli, P. Brennan, The modified nodal approach to network analysis (1975).
"""

from __future__ import annotations

from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray


@kernel(inline="always")
def stamp(
    inflow: FloatArray, conductance: FloatArray, i: int, j: int, flow: float, slope: float
) -> None:
    """Enter an element's flow [m³/s] from node i to node j and dQ/d(pᵢ − pⱼ)."""
    inflow[i] -= flow
    inflow[j] += flow
    conductance[i, i] += slope
    conductance[j, j] += slope
    conductance[i, j] -= slope
    conductance[j, i] -= slope


@kernel(borrows=True)
def solve_in_place(matrix: FloatArray, right: FloatArray, size: int) -> None:
    """Solve the symmetric positive definite system of the leading `size` rows into `right`.

    Elimination without pivoting that passes over zeros: a network of actuators that meet in a
    few common nodes, numbered last, costs O(actuators). Only the upper triangle is read.
    """
    for k in range(size):
        pivot = matrix[k, k]
        for i in range(k + 1, size):
            if matrix[k, i] == 0.0:
                continue
            factor = matrix[k, i] / pivot
            for j in range(i, size):
                matrix[i, j] -= factor * matrix[k, j]
            right[i] -= factor * right[k]
    for k in range(size - 1, -1, -1):
        total = right[k]
        for j in range(k + 1, size):
            total -= matrix[k, j] * right[j]
        right[k] = total / matrix[k, k]
