"""Joint trajectories: points in time, joined by quintic Hermite interpolation.

Times are integer nanoseconds, as in messages. So the sender and the receiver of a trajectory
evaluate exactly the same curve.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, TypeVar

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray, IntArray, frozen

SECOND_NS = 1_000_000_000

MAX_POINT_SPACING_NS = 20_000_000
"""Largest allowed time between neighbouring points [ns]; planner, braking and messages keep to
it."""

MAX_DURATION_NS = 600 * SECOND_NS
"""Longest duration of a trajectory that an arm accepts [ns]."""


class JointMotion(NamedTuple):
    """Positions, velocities and accelerations of n joints at k instants, as kernels take them.

    For a single instant the arrays have the shape (n,).

    Attributes:
        position: Joint positions, shape (k, n) [rad], or [m] if a joint slides.
        velocity: Joint velocities, shape (k, n) [rad/s or m/s].
        acceleration: Joint accelerations, shape (k, n) [rad/s² or m/s²].
    """

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray


@dataclass(frozen=True, eq=False)
class MotionState:
    """Position, velocity and acceleration of all joints at one instant.

    Attributes:
        position: Joint positions, shape (n,) [rad], or [m] if a joint slides.
        velocity: Joint velocities, shape (n,) [rad/s or m/s].
        acceleration: Joint accelerations, shape (n,) [rad/s² or m/s²].
    """

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray

    @classmethod
    def at_rest(cls, position: FloatArray) -> MotionState:
        """Return the state at a position [rad or m] with zero velocity and acceleration."""
        position = np.asarray(position, dtype=np.float64)
        return cls(position, np.zeros(position.shape), np.zeros(position.shape))

    @cached_property
    def is_moving(self) -> bool:
        """True if a velocity or an acceleration is not 0."""
        return any(self.velocity.tolist()) or any(self.acceleration.tolist())


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A joint trajectory over n joints, frozen and with read-only arrays.

    Between two points the curve is a quintic polynomial. At both points it has the point's
    position, velocity and acceleration. Creating a trajectory raises ValueError if shapes disagree,
    times do not increase or a number is not finite.

    Attributes:
        stamp_ns: Absolute time of the first point [ns].
        offset_ns: Times of the points after the stamp, the first is 0, strictly increasing, int64
            of shape (points,) [ns].
        position: Joint positions, shape (points, n) [rad], or [m] if a joint slides.
        velocity: Joint velocities, shape (points, n) [rad/s or m/s].
        acceleration: Joint accelerations, shape (points, n) [rad/s² or m/s²].
    """

    stamp_ns: int
    offset_ns: IntArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray

    def __post_init__(self) -> None:
        """Check shapes, times and values, and make the arrays read-only copies.

        Raises:
            ValueError: A shape is wrong, times do not start at 0 or do not increase, or a number is
                not finite.
        """
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
    def points(self) -> JointMotion:
        """Positions, velocities and accelerations at the points, of shape (points, n) each."""
        return JointMotion(self.position, self.velocity, self.acceleration)

    @property
    def joint_count(self) -> int:
        """Number of joints n."""
        return int(self.position.shape[1])

    @property
    def duration_ns(self) -> int:
        """Time from the first to the last point [ns]."""
        return int(self.offset_ns[-1])

    @property
    def end_ns(self) -> int:
        """Absolute time of the last point [ns]."""
        return self.stamp_ns + self.duration_ns

    @cached_property
    def _quintics(self) -> tuple[FloatArray, ...]:
        """Coefficients of the polynomial of each interval, six arrays of shape (points − 1, n)."""
        h = (np.diff(self.offset_ns) / SECOND_NS)[:, None]
        q, qd, qdd = self.points
        return compute_quintic(h, (q[:-1], qd[:-1], qdd[:-1]), (q[1:], qd[1:], qdd[1:]))

    def shifted(self, delta_ns: int) -> Trajectory:
        """Return this motion at a later time.

        Args:
            delta_ns: Time that is added to the stamp [ns]; the points keep their distance from the
                stamp.
        """
        return Trajectory(
            self.stamp_ns + delta_ns,
            self.offset_ns,
            self.position,
            self.velocity,
            self.acceleration,
        )

    def with_rest(self, rest_ns: int) -> Trajectory:
        """Return this motion followed by a standstill at its last position.

        During the standstill there are points with zero velocity and acceleration, at most
        `MAX_POINT_SPACING_NS` apart.

        Args:
            rest_ns: Duration of the standstill [ns].

        Returns:
            A longer trajectory with the same stamp.
        """
        points = -(-rest_ns // MAX_POINT_SPACING_NS)
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
        """Return the state of the motion at an absolute time.

        Before the first point, this is the state of the first point. After the last point, it is
        the last position with zero velocity and acceleration.

        Args:
            time_ns: Absolute time [ns].
        """
        since = min(max(int(time_ns) - self.stamp_ns, 0), self.duration_ns)
        if len(self.offset_ns) == 1:
            q, qd, qdd = (each[0].copy() for each in self.points)
        else:
            i = min(int(self.offset_ns.searchsorted(since, "right")), len(self.offset_ns) - 1) - 1
            s = (since - int(self.offset_ns[i])) / SECOND_NS
            q, qd, qdd = evaluate_quintic(s, tuple(each[i] for each in self._quintics))
        if time_ns > self.end_ns:
            qd, qdd = np.zeros(self.joint_count), np.zeros(self.joint_count)
        return MotionState(q, qd, qdd)

    def sample_many(self, time_ns: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Evaluate the motion at several absolute times.

        Before the first point, the state of the first point is returned. After the last point, it
        is the last position with zero velocity and acceleration.

        Args:
            time_ns: Absolute times in any order, shape (times,) [ns].

        Returns:
            Positions [rad or m], velocities and accelerations, each of shape (times, n), aligned
            with `time_ns`.
        """
        since = np.asarray(time_ns, dtype=np.int64) - self.stamp_ns
        ended = since > self.duration_ns
        since = np.clip(since, 0, self.duration_ns)
        if len(self.offset_ns) == 1:
            rows = np.zeros(len(since), dtype=np.int64)
            q, qd, qdd = self.position[rows], self.velocity[rows], self.acceleration[rows]
        else:
            after = np.searchsorted(self.offset_ns, since, "right")
            i = np.minimum(after, len(self.offset_ns) - 1) - 1
            s = ((since - self.offset_ns[i]) / SECOND_NS)[:, None]
            q, qd, qdd = evaluate_quintic(s, tuple(each[i] for each in self._quintics))
        qd = np.where(ended[:, None], 0.0, qd)
        qdd = np.where(ended[:, None], 0.0, qdd)
        return q, qd, qdd

    def sample_offsets(self, offset_ns: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Evaluate the motion at times after its stamp. The motion needs at least two points.

        Args:
            offset_ns: Times after the stamp in any order, none beyond the last point, shape
                (times,) [ns].

        Returns:
            Positions [rad or m], velocities and accelerations, each of shape (times, n), aligned
            with `offset_ns`.
        """
        rows = np.searchsorted(self.offset_ns[1:-1], offset_ns, "right")
        begin = self.offset_ns[rows]
        shares = (offset_ns - begin) / (self.offset_ns[rows + 1] - begin)
        return sample_states_at_shares(self.offset_ns / SECOND_NS, *self.points, rows, shares)


def standstill(position: FloatArray, time_ns: int = 0) -> Trajectory:
    """Return a trajectory of one point that stays at a position.

    Args:
        position: Joint positions, shape (n,) [rad or m].
        time_ns: Absolute time of the point [ns].
    """
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
    """Evaluate the quintic polynomial that joins two states.

    Python callers may pass arrays, which broadcast; kernels pass single numbers.

    Args:
        s: Time since the start of the interval [s].
        h: Duration of the interval, above 0 [s].
        start: Position, velocity and acceleration at s = 0.
        end: Position, velocity and acceleration at s = h.

    Returns:
        Position q, velocity dq/ds and acceleration d²q/ds² at s.
    """
    return evaluate_quintic(s, compute_quintic(h, start, end))


@kernel(plain=True)
def compute_quintic(
    h: Number, start: tuple[Number, Number, Number], end: tuple[Number, Number, Number]
) -> tuple[Number, ...]:
    """Compute the coefficients of the quintic polynomial that joins two states.

        q(s) = q₀ + v₀ s + ½ a₀ s² + c₃ s³ + c₄ s⁴ + c₅ s⁵

    q₀, v₀ and a₀ are the state at s = 0. The coefficients c₃, c₄ and c₅ follow from the state at s
    = h. Python callers may pass arrays, which broadcast; kernels pass single numbers.

    Args:
        h: Duration of the interval, above 0 [s].
        start: Position, velocity and acceleration at s = 0.
        end: Position, velocity and acceleration at s = h.

    Returns:
        q₀, v₀ and a₀ as in `start`, then c₃, c₄ and c₅.
    """
    q0, v0, a0 = start
    q1, v1, a1 = end
    dq = q1 - q0 - v0 * h - 0.5 * a0 * h**2
    dv = v1 - v0 - a0 * h
    da = a1 - a0
    c3 = (10 * dq - 4 * dv * h + 0.5 * da * h**2) / h**3
    c4 = (-15 * dq + 7 * dv * h - da * h**2) / h**4
    c5 = (6 * dq - 3 * dv * h + 0.5 * da * h**2) / h**5
    return q0, v0, a0, c3, c4, c5


@kernel(plain=True)
def evaluate_quintic(
    s: Number | float, coefficients: tuple[Number, ...]
) -> tuple[Number, Number, Number]:
    """Evaluate a quintic polynomial and its first two derivatives.

    Args:
        s: Time since the start of the interval [s].
        coefficients: q₀, v₀, a₀, c₃, c₄ and c₅ of `compute_quintic`; arrays broadcast with `s`.

    Returns:
        Position q, velocity dq/ds and acceleration d²q/ds² at s.
    """
    q0, v0, a0, c3, c4, c5 = coefficients
    q = q0 + s * (v0 + s * (0.5 * a0 + s * (c3 + s * (c4 + s * c5))))
    qd = v0 + s * (a0 + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)))
    qdd = a0 + s * (6 * c3 + s * (12 * c4 + s * 20 * c5))
    return q, qd, qdd


@kernel
def sample_states_at_shares(
    time: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
    rows: IntArray,
    shares: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Evaluate a trajectory at given shares of given intervals between its points.

    Between two points the trajectory is the quintic polynomial that joins their states.

    Args:
        time: Times of the points, increasing, shape (points,) [s].
        position: Joint positions at the points, shape (points, n) [rad or m].
        velocity: Joint velocities at the points, shape (points, n) [rad/s or m/s].
        acceleration: Joint accelerations at the points, shape (points, n) [rad/s² or m/s²].
        rows: Index of the interval for each of k samples, shape (k,). Interval i lasts from point i
            to point i + 1.
        shares: Position of each sample within its interval, as a share of the interval's duration,
            0 … 1, shape (k,).

    Returns:
        Positions, velocities and accelerations, each of shape (k, n).
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
def sample_midpoint_states(
    time: FloatArray, position: FloatArray, velocity: FloatArray, acceleration: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Evaluate a trajectory half-way in time between neighbouring points.

    Between two points the trajectory is the quintic polynomial that joins their states. At the
    midpoint its equation simplifies; tests compare the result with `quintic_hermite`.

    Args:
        time: Times of the points, increasing, shape (points,) [s].
        position: Joint positions at the points, shape (points, n) [rad or m].
        velocity: Joint velocities at the points, shape (points, n) [rad/s or m/s].
        acceleration: Joint accelerations at the points, shape (points, n) [rad/s² or m/s²].

    Returns:
        Positions, velocities and accelerations, each of shape (points − 1, n).
    """
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
