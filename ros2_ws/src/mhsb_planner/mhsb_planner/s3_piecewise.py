"""S3 where one polynomial will not do: curves that stay close to the discrete path.

`SmoothedPath` is the discrete path in cylinder lengths, in which every step runs at constant
piston speeds, smoothed by a cubic B-spline whose control points are taken from it at even times.
Lengths and piston speeds of the result are weighted means of the discrete ones, so that joint
limits, V_max and the pumps' flows hold by construction. `SteppedPath` rests at every node and
moves along exactly the postures that the search has admitted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from mhsb_model.arrays import MachineArrays
from mhsb_model.linkage import joint_angle, motion
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray
from mhsb_planner.discrete_path import DiscretePath
from mhsb_planner.s3_polynomial import node_times

SHORTEST_STEP = 0.1
"""Shortest duration of a step from rest to rest [s]."""


@dataclass(frozen=True, eq=False)
class SmoothedPath:
    """L(t) = Σ_i N_i(t/d) P_i with the uniform cubic B-splines N and knots every d seconds.

    control    float64[c, n] m, cylinder lengths; both ends three times, for rest at the ends
    knots      d [s]
    node_time  float64[k + 1] s, when the discrete path's nodes are due
    start      float64[n] rad
    """

    machine: Machine
    control: FloatArray
    knots: float
    node_time: FloatArray
    start: FloatArray

    @property
    def breaks(self) -> FloatArray:
        """Times between which the curve is smooth [s]."""
        return self.knots * np.arange(len(self.control) - 2, dtype=np.float64)

    def sample(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """q, q̇, q̈ at the rising times [s], float64[times, n] each."""
        arrays = self.machine.arrays
        return _joint_motion(arrays, self.control, self.knots, time, self.start)


def smoothed_path(
    machine: Machine, path: DiscretePath, window: float, stretch: float
) -> SmoothedPath:
    """Smooth a discrete path over `window` s, its durations multiplied by `stretch`.

    The window is the reach of one control point, four knots. The result lasts two to three knots
    longer than the path.
    """
    node_time = stretch * node_times(path)
    lengths = np.array([machine.cylinder_lengths(q) for q in path.posture])
    knots = window / 4
    cells = int(np.ceil(node_time[-1] / knots))
    # The last control point may lie up to one knot after the path's end; the path rests there.
    at = knots * np.arange(-2, cells + 3)
    control = np.column_stack(
        [np.interp(at, node_time, lengths[:, j]) for j in range(machine.joint_count)]
    )
    return SmoothedPath(machine, control, knots, node_time + knots, path.posture[0])


@dataclass(frozen=True, eq=False)
class SteppedPath:
    """q(t) from node to node, along straight lines in joint space, from rest to rest.

    q = q_i + Δq (10u³ − 15u⁴ + 6u⁵), u running from 0 to 1 over each step.
    """

    posture: FloatArray  # float64[k + 1, n] rad
    node_time: FloatArray  # float64[k + 1] s

    @property
    def breaks(self) -> FloatArray:
        """Times between which the curve is smooth [s]."""
        return self.node_time

    def sample(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """q, q̇, q̈ at the times [s], float64[times, n] each."""
        last = len(self.node_time) - 2
        step = np.clip(np.searchsorted(self.node_time, time, "right") - 1, 0, last)
        span = np.diff(self.node_time)[step]
        u = np.clip((time - self.node_time[step]) / span, 0.0, 1.0)[:, None]
        span = span[:, None]
        dq = np.diff(self.posture, axis=0)[step]
        q = self.posture[step] + dq * (10 * u**3 - 15 * u**4 + 6 * u**5)
        qd = dq * (30 * u**2 - 60 * u**3 + 30 * u**4) / span
        qdd = dq * (60 * u - 180 * u**2 + 120 * u**3) / span**2
        return q, qd, qdd


def stepped_path(path: DiscretePath, stretch: float) -> SteppedPath:
    """Steps from rest to rest; at stretch 1, 15/8 of T, they are as fast as the path at most."""
    duration = stretch * np.maximum(15 / 8 * path.duration, SHORTEST_STEP)
    return SteppedPath(path.posture, np.concatenate([[0.0], np.cumsum(duration)]))


@njit(cache=True, nogil=True)
def _spline(control: FloatArray, cell: int, j: int, u: float) -> tuple[float, float, float]:
    """Value and derivatives by u of a uniform cubic B-spline, u = 0 … 1 within one of its cells."""
    p0, p1 = control[cell, j], control[cell + 1, j]
    p2, p3 = control[cell + 2, j], control[cell + 3, j]
    w = 1.0 - u
    value = w**3 * p0 + (3 * u**3 - 6 * u**2 + 4) * p1
    value += (-3 * u**3 + 3 * u**2 + 3 * u + 1) * p2 + u**3 * p3
    slope = w**2 * (p1 - p0) + (1 + 2 * u - 2 * u**2) * (p2 - p1) + u**2 * (p3 - p2)
    return value / 6, slope / 2, w * (p2 - 2 * p1 + p0) + u * (p3 - 2 * p2 + p1)


@njit(cache=True, nogil=True)
def _joint_motion(
    m: MachineArrays, control: FloatArray, knots: float, time: FloatArray, start: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Joint motion of the cylinders' lengths: q = L⁻¹, q̇ = v/r, q̈ = (v̇ − r′ q̇²)/r.

    The search for q begins where the motion would have led from the instant before.
    """
    rows, n = len(time), control.shape[1]
    q, qd, qdd = np.empty((rows, n)), np.empty((rows, n)), np.empty((rows, n))
    cells = len(control) - 3
    for j in range(n):
        linkage, lower, upper = m.linkage[j], m.joint_min[j], m.joint_max[j]
        guess = start[j]
        for k in range(rows):
            cell = min(max(int(time[k] / knots), 0), cells - 1)
            length, speed, acceleration = _spline(control, cell, j, time[k] / knots - cell)
            q[k, j] = joint_angle(linkage, length, lower, upper, guess)
            _, arm, slope = motion(linkage, q[k, j])
            qd[k, j] = speed / knots / arm
            qdd[k, j] = (acceleration / knots**2 - slope * qd[k, j] ** 2) / arm
            if k + 1 < rows:
                ahead = time[k + 1] - time[k]
                guess = q[k, j] + ahead * (qd[k, j] + 0.5 * ahead * qdd[k, j])
    return q, qd, qdd
