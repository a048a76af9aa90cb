"""Pistons whose speeds change by ramps.

    L(t) = L₀ + v₀ t + Σᵢ Δvᵢ (R(t − tᵢ) − R(−tᵢ)),   v(t) = v₀ + Σᵢ Δvᵢ ρ(t − tᵢ),
    v̇(t) = Σᵢ Δvᵢ k(t − tᵢ),   R = ∫ρ dt, ρ and k of a ramp (`s3_ramps`)
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray
from mhsb_planner.motion.piston_motion import joint_motion
from mhsb_planner.motion.s3_ramps import TICK, ramp_at

NEGLIGIBLE = 1e-9
"""A smaller change of speed is rounding [m/s]."""

GENTLE = 1.0 + 1e-6
"""Accelerations and jerks beyond their limits by less are rounding."""


@dataclass(frozen=True, eq=False)
class RampedMotion:
    """Pistons whose speeds change by ramps.

    start      float64[n] rad, posture at time 0
    length     float64[n] m, L at time 0
    speed      float64[n] m/s, before the first ramp
    at         float64[c] s, when each ramp begins; some before time 0
    change     float64[c, n] m/s, the speeds' change
    rise, blend  float64[c] s, of each ramp (`s3_ramps.Ramp`)
    node_time  float64[k + 1] s, when the discrete path's nodes are due
    """

    machine: Machine
    start: FloatArray
    length: FloatArray
    speed: FloatArray
    at: FloatArray
    change: FloatArray
    rise: FloatArray
    blend: FloatArray
    node_time: FloatArray

    @property
    def end(self) -> float:
        """When all ramps are over [s]."""
        return float(self.breaks[-1])

    @cached_property
    def breaks(self) -> FloatArray:
        """Times from 0 to the end between which the jerk is constant, at least a TICK apart [s].

        Ramps that change speeds by no more than rounding do not count.
        """
        return _breaks(self.at, self.change, self.rise, self.blend)

    def sample(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """q, q̇, q̈ at ascending times [s], float64[times, n] each."""
        return joint_motion(self.machine.arrays, *self.pistons(time), self.start)

    def pistons(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Lengths, piston speeds, accelerations at ascending times [s], float64[times, n] each."""
        return _pistons(
            time, self.length, self.speed, self.at, self.change, self.rise, self.blend
        )

    @cached_property
    def peaks(self) -> tuple[float, float]:
        """The largest acceleration and jerk of a piston, as shares of what is allowed.

        Between breaks the acceleration is linear in time.
        """
        m, time = self.machine.arrays, self.breaks
        acceleration, jerk = _peaks(time, self.pistons(time)[2])
        return acceleration / m.max_piston_acceleration, jerk / m.max_piston_jerk

    @property
    def gentle(self) -> bool:
        """Whether acceleration and jerk are within their limits."""
        return max(self.peaks) <= GENTLE

    def plus(self, other: RampedMotion) -> RampedMotion:
        """This motion with another one's ramps, and its nodes."""
        return RampedMotion(
            self.machine,
            self.start,
            self.length,
            self.speed + other.speed,
            np.concatenate([self.at, other.at]),
            np.vstack([self.change, other.change]),
            np.concatenate([self.rise, other.rise]),
            np.concatenate([self.blend, other.blend]),
            other.node_time,
        )


@kernel
def _breaks(
    at: FloatArray, change: FloatArray, rise: FloatArray, blend: FloatArray
) -> FloatArray:
    """Kernel of `RampedMotion.breaks`."""
    inner, count, end = np.empty(4 * len(at)), 0, TICK
    for i in range(len(at)):
        if np.abs(change[i]).max() > NEGLIGIBLE:
            for since in (0.0, blend[i], rise[i], rise[i] + blend[i]):
                inner[count] = at[i] + since
                count += 1
            end = max(end, at[i] + rise[i] + blend[i])
    inner = inner[:count]
    inner.sort()
    kept, apart = np.zeros(count + 2), (1.0 - 1e-6) * TICK
    last = 0
    for time in inner:
        if kept[last] + apart <= time <= end - apart:
            last += 1
            kept[last] = time
    kept[last + 1] = end
    return kept[: last + 2]


@kernel
def _peaks(time: FloatArray, acceleration: FloatArray) -> tuple[float, float]:
    """Largest acceleration [m/s²] and jerk [m/s³] of accelerations [k, n] linear between times."""
    highest = steepest = 0.0
    for k in range(len(time)):
        for j in range(acceleration.shape[1]):
            highest = max(highest, abs(acceleration[k, j]))
            if k > 0:
                change = acceleration[k, j] - acceleration[k - 1, j]
                steepest = max(steepest, abs(change) / (time[k] - time[k - 1]))
    return highest, steepest


@kernel
def _pistons(
    time: FloatArray,
    start: FloatArray,
    speed: FloatArray,
    at: FloatArray,
    change: FloatArray,
    rise: FloatArray,
    blend: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Kernel of `RampedMotion.pistons`, times ascending; oracle: the path convolved numerically.

    A ramp that is over leaves a change of speed and a lag behind it, which are summed up.
    """
    rows, n = len(time), len(start)
    length, velocity = np.zeros((rows, n)), np.zeros((rows, n))
    acceleration, over, lag = np.zeros((rows, n)), np.zeros((rows, n)), np.zeros((rows, n))
    for i in range(len(at)):
        before, _, _ = ramp_at(rise[i], blend[i], -at[i])
        duration = rise[i] + blend[i]
        k = 0
        while k < rows and time[k] <= at[i]:
            k += 1
        while k < rows and time[k] < at[i] + duration:
            way, share, rate = ramp_at(rise[i], blend[i], time[k] - at[i])
            for j in range(n):
                length[k, j] += change[i, j] * (way - before)
                velocity[k, j] += change[i, j] * share
                acceleration[k, j] += change[i, j] * rate
            k += 1
        if k < rows:
            for j in range(n):
                over[k, j] += change[i, j]
                lag[k, j] += change[i, j] * (at[i] + 0.5 * duration + before)
    for j in range(n):
        constant, behind = speed[j], -start[j]
        for k in range(rows):
            constant += over[k, j]
            behind += lag[k, j]
            length[k, j] += constant * time[k] - behind
            velocity[k, j] += constant
    return length, velocity, acceleration
