"""Joint trajectories: points in time, joined by quintic Hermite interpolation.

Times are integer nanoseconds, as on the wire, so that the sender and the receiver of a
trajectory evaluate the very same curve.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray, IntArray, frozen

SECOND_NS = 1_000_000_000

POINT_SPACING_NS = 20_000_000
"""Largest distance of neighbouring points that planner, braking and wire agree on."""

LONGEST_NS = 600 * SECOND_NS
"""Longest duration that an arm takes."""


@dataclass(frozen=True, eq=False)
class MotionState:
    """Position [rad], velocity [rad/s] and acceleration [rad/s²] of all joints, float64[n]."""

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray

    @classmethod
    def at_rest(cls, position: FloatArray) -> MotionState:
        """The state that stands still at `position` [rad]."""
        position = np.asarray(position, dtype=np.float64)
        return cls(position, np.zeros_like(position), np.zeros_like(position))


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A joint trajectory over n joints.

    stamp_ns      absolute time of the first point, integer ns
    offset_ns     int64[points], times after the stamp, first 0, strictly increasing
    position      float64[points, n], rad
    velocity      float64[points, n], rad/s
    acceleration  float64[points, n], rad/s²

    Between two points the curve is the quintic that takes on both points' position,
    velocity and acceleration. Raises ValueError where shapes, order or finiteness fail.
    """

    stamp_ns: int
    offset_ns: IntArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray

    def __post_init__(self) -> None:
        offset = np.asarray(self.offset_ns, dtype=np.int64)
        if offset.ndim != 1 or len(offset) == 0:
            raise ValueError("a trajectory needs at least one point")
        if offset[0] != 0 or (offset[1:] <= offset[:-1]).any():
            raise ValueError("point times must start at 0 and increase strictly")
        object.__setattr__(self, "stamp_ns", int(self.stamp_ns))
        object.__setattr__(self, "offset_ns", frozen(offset))
        for name in ("position", "velocity", "acceleration"):
            values = np.asarray(getattr(self, name), dtype=np.float64)
            if values.ndim != 2 or len(values) != len(offset):
                raise ValueError(f"{name} must have one row of joints for each point")
            if values.shape != np.shape(self.position):
                raise ValueError(f"{name} must have as many joints as position")
            if not np.isfinite(values).all():
                raise ValueError(f"{name} must be finite everywhere")
            object.__setattr__(self, name, frozen(values))

    @property
    def joint_count(self) -> int:
        """Number of joints n."""
        return int(self.position.shape[1])

    @property
    def duration_ns(self) -> int:
        """Time from the first to the last point, ns."""
        return int(self.offset_ns[-1])

    @property
    def end_ns(self) -> int:
        """Absolute time of the last point, ns."""
        return self.stamp_ns + self.duration_ns

    def shifted(self, delta_ns: int) -> Trajectory:
        """The same motion, `delta_ns` later."""
        return Trajectory(
            self.stamp_ns + delta_ns,
            self.offset_ns,
            self.position,
            self.velocity,
            self.acceleration,
        )

    def rested(self, rest_ns: int) -> Trajectory:
        """The same motion, and then a rest at its end for `rest_ns`."""
        points = -(-rest_ns // POINT_SPACING_NS)
        rest = self.duration_ns + rest_ns * np.arange(1, points + 1) // points
        still = np.zeros((points, self.joint_count))
        return Trajectory(
            self.stamp_ns,
            np.concatenate([self.offset_ns, rest]),
            np.vstack([self.position, self.position[-1] + still]),
            np.vstack([self.velocity, still]),
            np.vstack([self.acceleration, still]),
        )

    def sample(self, time_ns: int) -> MotionState:
        """State at the absolute time `time_ns`; held at rest after the end."""
        q, qd, qdd = self.sample_many(np.array([time_ns], dtype=np.int64))
        return MotionState(q[0], qd[0], qdd[0])

    def sample_many(self, time_ns: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Positions, velocities, accelerations, float64[times, n] each, at absolute times.

        Before the first point its state is returned; after the end the last position, at rest.
        """
        since = np.asarray(time_ns, dtype=np.int64) - self.stamp_ns
        ended = since > self.duration_ns
        since = np.clip(since, 0, self.duration_ns)
        if len(self.offset_ns) == 1:
            rows = np.zeros(len(since), dtype=np.int64)
            q, qd, qdd = self.position[rows], self.velocity[rows], self.acceleration[rows]
        else:
            i = np.clip(np.searchsorted(self.offset_ns, since, "right") - 1, 0, None)
            i = np.minimum(i, len(self.offset_ns) - 2)
            h = ((self.offset_ns[i + 1] - self.offset_ns[i]) / SECOND_NS)[:, None]
            s = ((since - self.offset_ns[i]) / SECOND_NS)[:, None]
            q, qd, qdd = quintic_hermite(
                s,
                h,
                (self.position[i], self.velocity[i], self.acceleration[i]),
                (self.position[i + 1], self.velocity[i + 1], self.acceleration[i + 1]),
            )
        qd = np.where(ended[:, None], 0.0, qd)
        qdd = np.where(ended[:, None], 0.0, qdd)
        return q, qd, qdd

    def inside(
        self, rows: IntArray, shares: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Positions, velocities, accelerations within intervals, float64[rows · shares, n] each.

        rows    int64[rows], intervals: the first lasts from point 0 to point 1
        shares  float64[shares], 0 … 1, of an interval's duration; for each row all of them
        """
        return self._within(np.repeat(rows, len(shares)), np.tile(shares, len(rows)))

    def middles(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Positions, velocities, accelerations half-way between points, float64[k − 1, n] each."""
        time = self.offset_ns / SECOND_NS
        return _middles(time, self.position, self.velocity, self.acceleration)

    def at_offsets(self, offset_ns: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The same at times after the stamp that lie between the first and the last point."""
        rows = np.searchsorted(self.offset_ns[1:-1], offset_ns, "right")
        begin = self.offset_ns[rows]
        return self._within(rows, (offset_ns - begin) / (self.offset_ns[rows + 1] - begin))

    def _within(
        self, rows: IntArray, shares: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        time = self.offset_ns / SECOND_NS
        motion = self.position, self.velocity, self.acceleration
        return states_within(time, *motion, rows, shares)


def standstill(position: FloatArray, time_ns: int = 0) -> Trajectory:
    """The trajectory of one point that stays at `position` float64[n] rad from `time_ns` on."""
    still = np.zeros((1, len(position)))
    return Trajectory(time_ns, np.array([0]), np.asarray(position)[None, :], still, still)


Number = TypeVar("Number", float, FloatArray)


@kernel(plain=True)
def quintic_hermite(
    s: Number,
    h: Number,
    start: tuple[Number, Number, Number],
    end: tuple[Number, Number, Number],
) -> tuple[Number, Number, Number]:
    """Quintic through both ends' position, velocity and acceleration, at time s of h [s].

    q(s) = q0 + v0 s + a0 s²/2 + c3 s³ + c4 s⁴ + c5 s⁵, the last three from the end
    conditions. For arrays, which broadcast, and for single numbers in kernels; returns q, dq/ds,
    d²q/ds².
    """
    q0, v0, a0 = start
    q1, v1, a1 = end
    dq = q1 - q0 - v0 * h - 0.5 * a0 * h**2
    dv = v1 - v0 - a0 * h
    da = a1 - a0
    c3 = (10 * dq - 4 * dv * h + 0.5 * da * h**2) / h**3
    c4 = (-15 * dq + 7 * dv * h - da * h**2) / h**4
    c5 = (6 * dq - 3 * dv * h + 0.5 * da * h**2) / h**5
    q = q0 + s * (v0 + s * (0.5 * a0 + s * (c3 + s * (c4 + s * c5))))
    qd = v0 + s * (a0 + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)))
    qdd = a0 + s * (6 * c3 + s * (12 * c4 + s * 20 * c5))
    return q, qd, qdd


@kernel
def states_within(
    time: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
    rows: IntArray,
    shares: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """States in intervals, after shares of each one's duration, float64[rows, n] each.

    time float64[points] s, the trajectory's arrays, rows int64[rows] of its intervals, and
    shares float64[rows]. Oracle: `Trajectory.sample_many`.
    """
    n = position.shape[1]
    q, qd, qdd = np.empty((len(rows), n)), np.empty((len(rows), n)), np.empty((len(rows), n))
    for k in range(len(rows)):
        i = rows[k]
        h = time[i + 1] - time[i]
        for j in range(n):
            start = (position[i, j], velocity[i, j], acceleration[i, j])
            end = (position[i + 1, j], velocity[i + 1, j], acceleration[i + 1, j])
            q[k, j], qd[k, j], qdd[k, j] = quintic_hermite(shares[k] * h, h, start, end)
    return q, qd, qdd


@kernel
def _middles(
    time: FloatArray, position: FloatArray, velocity: FloatArray, acceleration: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Kernel of `Trajectory.middles`: `quintic_hermite` at h/2; its oracle is `inside`."""
    rows, n = len(time) - 1, position.shape[1]
    q, qd, qdd = np.empty((rows, n)), np.empty((rows, n)), np.empty((rows, n))
    for k in range(rows):
        h = time[k + 1] - time[k]
        for j in range(n):
            q0, v0, a0 = position[k, j], velocity[k, j], acceleration[k, j]
            q1, v1, a1 = position[k + 1, j], velocity[k + 1, j], acceleration[k + 1, j]
            q[k, j] = 0.5 * (q0 + q1) + h * (10.0 * (v0 - v1) + h * (a0 + a1)) / 64.0
            qd[k, j] = 1.875 * (q1 - q0) / h - (14.0 * (v0 + v1) + h * (a0 - a1)) / 32.0
            qdd[k, j] = 1.5 * (v1 - v0) / h - 0.25 * (a0 + a1)
    return q, qd, qdd
