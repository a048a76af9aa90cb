"""Points of a trajectory, taken from a smooth curve."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.trajectory import POINT_SPACING_NS, SECOND_NS, MotionState, Trajectory
from mhsb_model.types import FloatArray, IntArray, frozen

FEWEST_INTERVALS = 10
"""Intervals between a trajectory's points, at least."""


class SmoothCurve(Protocol):
    """A joint motion."""

    @property
    def breaks(self) -> FloatArray:
        """Times between which the curve is smooth, from 0 to its end [s]."""

    def sample(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """q, q̇, q̈ at the times [s], float64[times, n] each."""


def sampled_trajectory(curve: SmoothCurve, start: MotionState, end: FloatArray) -> Trajectory:
    """Points of a curve with stamp 0, exact at both ends: from `start` to rest at `end` [rad].

    A polynomial from or to rest has an acceleration there; its first and last interval ramp it.
    """
    offset = point_times(curve.breaks)
    q, qd, qdd = curve.sample(offset / SECOND_NS)
    q[0], qd[0], qdd[0] = start.position, start.velocity, start.acceleration
    q[-1], qd[-1], qdd[-1] = end, 0.0, 0.0
    return Trajectory(0, offset, q, qd, qdd)


def joined(lead_in: Trajectory, curve: Trajectory) -> Trajectory:
    """A lead-in that ends where a curve begins, and the curve, with stamp 0."""
    return Trajectory(
        0,
        np.concatenate([lead_in.offset_ns[:-1], lead_in.duration_ns + curve.offset_ns]),
        np.vstack([lead_in.position[:-1], curve.position]),
        np.vstack([lead_in.velocity[:-1], curve.velocity]),
        np.vstack([lead_in.acceleration[:-1], curve.acceleration]),
    )


def point_times(breaks: FloatArray) -> IntArray:
    """Times of a trajectory's points, ns: the breaks [s], and evenly spread between them.

    With points at the breaks, quintics between the points follow the curve within rounding.
    """
    return _point_times(frozen(breaks))


@kernel
def _point_times(breaks: FloatArray) -> IntArray:
    """Kernel of `point_times`."""
    at_ns = np.rint(breaks * SECOND_NS).astype(np.int64)
    spans = len(at_ns) - 1
    parts, fewest = np.empty(spans, dtype=np.int64), -(-FEWEST_INTERVALS // spans)
    for i in range(spans):
        parts[i] = max(-(-(at_ns[i + 1] - at_ns[i]) // POINT_SPACING_NS), fewest)
    times, k = np.empty(parts.sum() + 1, dtype=np.int64), 0
    for i in range(spans):
        step = (at_ns[i + 1] - at_ns[i]) / parts[i]
        for part in range(parts[i]):
            times[k] = at_ns[i] + np.int64(np.rint(part * step))
            k += 1
    times[k] = at_ns[-1]
    return times
