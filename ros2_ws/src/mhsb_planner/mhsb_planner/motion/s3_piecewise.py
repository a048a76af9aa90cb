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

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.linkages.linkage import cylinder_length, joint_angle, motion
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray
from mhsb_planner.motion.s3_polynomial import node_times
from mhsb_planner.search.discrete_path import DiscretePath

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
        """q, q̇, q̈ at the times [s], float64[times, n] each."""
        return joint_motion(self.machine.arrays, *self.pistons(time), self.start)

    def pistons(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Lengths, piston speeds and accelerations at the times [s], float64[times, n] each."""
        cells = len(self.control) - 3
        cell = np.clip((time / self.knots).astype(np.int64), 0, cells - 1)
        u = (time / self.knots - cell)[:, None]
        p0, p1, p2, p3 = (self.control[cell + i] for i in range(4))
        length = ((1 - u) ** 3 * p0 + (3 * u**3 - 6 * u**2 + 4) * p1) / 6
        length += ((-3 * u**3 + 3 * u**2 + 3 * u + 1) * p2 + u**3 * p3) / 6
        speed = (1 - u) ** 2 * (p1 - p0) + (1 + 2 * u - 2 * u**2) * (p2 - p1) + u**2 * (p3 - p2)
        speed /= 2 * self.knots
        acceleration = ((1 - u) * (p2 - 2 * p1 + p0) + u * (p3 - 2 * p2 + p1)) / self.knots**2
        return length, speed, acceleration


def smoothed_path(
    machine: Machine, path: DiscretePath, window: float, stretch: float
) -> SmoothedPath:
    """Smooth a discrete path over `window` s, its durations multiplied by `stretch`.

    The window is the reach of one control point, four knots; it is adjusted so that the path
    lasts a whole number of knots. The result lasts two knots longer.
    """
    node_time = stretch * node_times(path)
    lengths = _lengths(machine.arrays, path.posture)
    cells = max(1, round(node_time[-1] / (window / 4)))
    knots = max(window / 4, node_time[-1]) if cells == 1 else node_time[-1] / cells
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


@kernel
def _lengths(m: MachineArrays, posture: FloatArray) -> FloatArray:
    """Cylinder lengths [m] in the postures [k, n]."""
    length = np.empty(posture.shape)
    for k in range(len(posture)):
        for j in range(posture.shape[1]):
            length[k, j] = cylinder_length(m.linkage[j], posture[k, j])
    return length


@kernel
def joint_motion(
    m: MachineArrays,
    length: FloatArray,
    speed: FloatArray,
    acceleration: FloatArray,
    start: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Joint motion of a piston motion: q = L⁻¹, q̇ = v/r, q̈ = (v̇ − r′ q̇²)/r.

    The search for q begins where the two instants before lead. Beyond the joint limits the linkage
    goes on as straight as it is there, so that a motion that passes them shows it.
    """
    rows, n = length.shape
    q, qd, qdd = np.empty((rows, n)), np.empty((rows, n)), np.empty((rows, n))
    for j in range(n):
        linkage, lower, upper = m.linkage[j], m.joint_min[j], m.joint_max[j]
        guess = start[j]
        for k in range(rows):
            within = joint_angle(linkage, length[k, j], lower, upper, guess)
            reached, arm, slope = motion(linkage, within)
            q[k, j] = within + (length[k, j] - reached) / arm
            qd[k, j] = speed[k, j] / arm
            qdd[k, j] = (acceleration[k, j] - slope * qd[k, j] ** 2) / arm
            guess = within if k == 0 else 2.0 * within - q[k - 1, j]
    return q, qd, qdd
