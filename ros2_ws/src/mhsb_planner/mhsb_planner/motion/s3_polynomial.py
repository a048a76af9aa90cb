"""S3 as published: one sixth-degree polynomial per joint over the whole move.

In normalised time s = t/T the polynomial is p(s) = h(s) + w(s) Σ c_i B_i(s): h fulfils the
boundary conditions, w vanishes with them, and the free coefficients c are least squares to the
discrete path. Rows are scaled by Δq (position) and Δq/T (velocity); Δq is common to all rows of
a joint and drops out, T turns velocities into dq/ds.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.polynomial import polynomial as series

from mhsb_model.trajectory import MotionState
from mhsb_model.types import FloatArray, frozen
from mhsb_planner.search.discrete_path import DiscretePath

DEGREE = 6
SHORTEST_STEP = 1e-6
"""A step of the discrete path that takes less time is given this much [s]."""
INSTANTS = frozen((np.arange(96) + 0.5) / 96)
"""Normalised times, evenly spread, at which the polynomials are held to the discrete path."""


@dataclass(frozen=True, eq=False)
class PolynomialCurve:
    """q_j(t) = Σ_i coefficient[i, j] (t/T)^i.

    coefficient  float64[7, n] rad
    duration     T [s]
    node_time    float64[k + 1] s, when the discrete path's nodes are due
    """

    coefficient: FloatArray
    duration: float
    node_time: FloatArray

    @property
    def breaks(self) -> FloatArray:
        """Times between which the curve is smooth [s]."""
        return np.array([0.0, self.duration])

    def sample(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """q, q̇, q̈ at the times [s], float64[times, n] each."""
        powers = np.vander(time / self.duration, DEGREE + 1, increasing=True)
        first = _slope(self.coefficient)
        return (
            powers @ self.coefficient,
            powers[:, :-1] @ first / self.duration,
            powers[:, :-2] @ _slope(first) / self.duration**2,
        )


def fit_polynomial(
    path: DiscretePath, start: MotionState, delay: float, stretch: float
) -> PolynomialCurve:
    """Polynomial from `start` to rest at the path's end, as close as possible to the path.

    delay    s, from the start to the path's first node: what a moving start needs to get there
    stretch  factor on delay and on the path's durations

    Conditions: position and velocity at both ends, the acceleration also at a moving start.
    """
    node_time = stretch * (delay + node_times(path))
    duration = float(node_time[-1])
    moving = bool(start.velocity.any() or start.acceleration.any())
    boundary = _boundary(start, path.posture[-1], duration, moving)
    position, velocity = _discrete(path, start, node_time, INSTANTS * duration)
    wanted = np.vstack([position, velocity * duration])
    basis, inverse = _free_terms(5 if moving else 4)
    weights = inverse @ (wanted - _rows(INSTANTS, boundary))
    return PolynomialCurve(boundary + basis @ weights, duration, node_time)


def node_times(path: DiscretePath) -> FloatArray:
    """When the nodes of a discrete path are due, from 0, float64[k + 1] s."""
    return np.concatenate([[0.0], np.cumsum(np.maximum(path.duration, SHORTEST_STEP))])


def _discrete(
    path: DiscretePath, start: MotionState, node_time: FloatArray, time: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Joint-wise linear interpolation of the discrete path: positions and velocities at `time`."""
    times, nodes = node_time, path.posture
    if node_time[0] > 0.0:
        times = np.concatenate([[0.0], node_time])
        nodes = np.vstack([start.position, nodes])
    step = np.clip(np.searchsorted(times, time, "right") - 1, 0, len(times) - 2)
    velocity = np.diff(nodes, axis=0) / np.diff(times)[:, None]
    return nodes[step] + velocity[step] * (time - times[step])[:, None], velocity[step]


def _boundary(start: MotionState, end: FloatArray, duration: float, moving: bool) -> FloatArray:
    """The polynomial of least degree that fulfils the boundary conditions, float64[7, n]."""
    result = np.zeros((DEGREE + 1, len(end)))
    dq = end - start.position
    result[0], result[1] = start.position, start.velocity * duration
    if moving:
        result[2] = start.acceleration * duration**2 / 2
        left = dq - result[1] - result[2]  # for the cubic and quartic terms at s = 1
        slope = -result[1] - 2 * result[2]  # likewise
        result[3], result[4] = 4 * left - slope, slope - 3 * left
    else:
        result[2], result[3] = 3 * dq - 2 * result[1], result[1] - 2 * dq
    return result


@cache
def _free_terms(conditions: int) -> tuple[FloatArray, FloatArray]:
    """The polynomials w(s) B_i(s), float64[7, free], and the pseudo-inverse of their rows.

    w = s²(1 − s)², or s³(1 − s)² where the start's acceleration is a condition too;
    B_i = (2s − 1)^i, which keeps the least squares well conditioned.
    """
    window = series.polyfromroots([0.0] * (conditions - 2) + [1.0] * 2)
    basis = np.zeros((DEGREE + 1, DEGREE + 1 - conditions))
    for i in range(basis.shape[1]):
        term = series.polymul(window, series.polypow([-1.0, 2.0], i))
        basis[: len(term), i] = term
    return frozen(basis), frozen(np.linalg.pinv(_rows(INSTANTS, basis)))


def _rows(s: FloatArray, coefficient: FloatArray) -> FloatArray:
    """Values and slopes dp/ds of polynomials in s, one below the other."""
    powers = s[:, None] ** np.arange(DEGREE + 1)
    return np.vstack([powers @ coefficient, powers[:, :-1] @ _slope(coefficient)])


def _slope(coefficient: FloatArray) -> FloatArray:
    """Coefficients of the derivative."""
    return coefficient[1:] * np.arange(1.0, len(coefficient))[:, None]
