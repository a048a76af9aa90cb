"""Piston motions whose speeds change by ramps, with limited acceleration and jerk.

    L(t) = L₀ + v₀ t + Σᵢ Δvᵢ (R(t − tᵢ) − R(−tᵢ))
    v(t) = v₀ + Σᵢ Δvᵢ ρ(t − tᵢ)
    v̇(t) = Σᵢ Δvᵢ k(t − tᵢ)

L is the cylinder length and v the piston speed. L₀ is the length at time 0, and v₀ the speed before
the first ramp. Ramp i begins at tᵢ and changes the speed by Δvᵢ. ρ rises from 0 to 1 during the
ramp (`s3_ramps`). k is the derivative of ρ, and R its integral.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.kernels.sorting import sort_in_place
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray, as_frozen
from mhsb_planner.motion.piston_motion import convert_to_joints
from mhsb_planner.motion.s3_ramps import RAMP_TIME_STEP, evaluate_ramp

SPEED_ROUNDING = 1e-9
"""Largest change of speed that counts as rounding [m/s]."""

LIMIT_ROUNDING_FACTOR = 1.0 + 1e-6
"""Factor on the limits of acceleration and jerk; an excess up to this factor counts as rounding
[-].
"""


@dataclass(frozen=True, eq=False)
class RampedMotion:
    """Motion of n pistons whose speeds change by c ramps.

    A ramp changes the speeds by a trapezoid of acceleration. Counted from the ramp's beginning, the
    acceleration builds up until T₂, begins to decrease at T₁, and is 0 from T₁ + T₂ on.

    Attributes:
        machine: Machine that moves.
        start: Joint positions at time 0, shape (n,) [rad or m].
        length: Cylinder lengths at time 0, shape (n,) [m].
        speed: Piston speeds before the first ramp, shape (n,) [m/s].
        ramp_begin: Time at which each ramp begins, shape (c,) [s]. Some begin before time 0.
        change: Change of the piston speeds in each ramp, shape (c, n) [m/s].
        rise: Time T₁ of each ramp, shape (c,) [s].
        blend: Time T₂ of each ramp, shape (c,) [s].
        node_time: Time at which the motion is to be at each node of the discrete path, shape (k +
            1,) [s]. The ramps cut the path's corners.
    """

    machine: Machine
    start: FloatArray
    length: FloatArray
    speed: FloatArray
    ramp_begin: FloatArray
    change: FloatArray
    rise: FloatArray
    blend: FloatArray
    node_time: FloatArray

    @property
    def end(self) -> float:
        """Time at which the last ramp is over [s]."""
        return float(self.breaks[-1])

    @property
    def breaks(self) -> FloatArray:
        """Times at which the jerk changes, from 0 to the end of the motion, shape (m,) [s].

        Times less than `RAMP_TIME_STEP` apart are merged. Ramps with changes of speed below
        rounding are left out.
        """
        return self._breaks_and_peaks[0]

    @cached_property
    def _breaks_and_peaks(self) -> tuple[FloatArray, float, float]:
        """Times of `breaks` [s], and largest piston acceleration [m/s²] and jerk [m/s³]."""
        return _find_breaks_and_peaks(self.ramp_begin, self.change, self.rise, self.blend)

    def sample(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Compute the joint motion at given times.

        Args:
            time: Times in ascending order from the start of the motion, shape (k,) [s].

        Returns:
            Joint positions [rad or m], velocities [rad/s or m/s] and accelerations
            [rad/s² or m/s²], of shape (k, n).
        """
        pistons = self.sample_pistons(time)
        return convert_to_joints(self.machine.arrays, *pistons, as_frozen(self.start))

    def sample_pistons(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Compute the piston motion at given times.

        Args:
            time: Times in ascending order from the start of the motion, shape (k,) [s].

        Returns:
            Cylinder lengths [m], piston speeds [m/s] and accelerations [m/s²], of shape (k, n).
        """
        return _sample_pistons(
            time, self.length, self.speed, self.ramp_begin, self.change, self.rise, self.blend
        )

    @property
    def peaks(self) -> tuple[float, float]:
        """Largest acceleration and jerk of a piston, as fractions of the machine's limits [-]."""
        m, (_, acceleration, jerk) = self.machine.arrays, self._breaks_and_peaks
        return acceleration / m.max_piston_acceleration, jerk / m.max_piston_jerk

    @property
    def keeps_dynamic_limits(self) -> bool:
        """True if acceleration and jerk of all pistons are within the machine's limits."""
        return max(self.peaks) <= LIMIT_ROUNDING_FACTOR

    def superpose(self, other: RampedMotion) -> RampedMotion:
        """Return the sum of this motion and another motion, with the ramps of both.

        Start posture and initial cylinder lengths are taken from this motion. The speeds before the
        first ramp are added.

        Args:
            other: Motion whose ramps are added. The sum gets its `node_time`.

        Returns:
            The sum. Both motions stay unchanged.
        """
        return RampedMotion(
            self.machine,
            self.start,
            self.length,
            self.speed + other.speed,
            np.concatenate([self.ramp_begin, other.ramp_begin]),
            np.vstack([self.change, other.change]),
            np.concatenate([self.rise, other.rise]),
            np.concatenate([self.blend, other.blend]),
            other.node_time,
        )


@kernel
def _find_breaks(
    at: FloatArray, change: FloatArray, rise: FloatArray, blend: FloatArray
) -> FloatArray:
    """Compute the times at which the jerk of a ramped motion changes.

    A ramp changes the piston speeds by a trapezoid of acceleration. Counted from the ramp's
    beginning, the acceleration builds up until T₂, begins to decrease at T₁, and is 0 from T₁ + T₂
    on. The jerk changes at 0, T₂, T₁ and T₁ + T₂.

    Ramps that change no speed by more than SPEED_ROUNDING are ignored. If times are less than
    RAMP_TIME_STEP apart, only the first of them is kept. The end is always kept, and times less
    than RAMP_TIME_STEP before the end are left out.

    Args:
        at: Time at which each ramp begins, shape (c,) [s].
        change: Change of the piston speeds in each ramp, shape (c, n) [m/s].
        rise: Time T₁ from the beginning of each ramp until its acceleration begins to fall, shape
            (c,) [s].
        blend: Time T₂ of each ramp, shape (c,) [s]. The acceleration rises for T₂ at the ramp's
            beginning, and falls for T₂ at its end.

    Returns:
        Ascending times [s]. The first is 0. The last is the end of the last ramp, but at least
        RAMP_TIME_STEP.
    """
    inner, count, end = np.empty(4 * len(at)), 0, RAMP_TIME_STEP
    for i in range(len(at)):
        largest = 0.0
        for each in change[i]:
            largest = max(largest, abs(each))
        if largest > SPEED_ROUNDING:
            for since in (0.0, blend[i], rise[i], rise[i] + blend[i]):
                inner[count] = at[i] + since
                count += 1
            end = max(end, at[i] + rise[i] + blend[i])
    sort_in_place(inner, count)
    kept, apart = np.zeros(count + 2), (1.0 - 1e-6) * RAMP_TIME_STEP
    last = 0
    for time in inner[:count]:
        if kept[last] + apart <= time <= end - apart:
            last += 1
            kept[last] = time
    kept[last + 1] = end
    return kept[: last + 2]


@kernel
def _sample_pistons(
    time: FloatArray,
    start: FloatArray,
    speed: FloatArray,
    at: FloatArray,
    change: FloatArray,
    rise: FloatArray,
    blend: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute lengths, speeds and accelerations of the pistons of a ramped motion.

    A ramp changes the piston speeds by a trapezoid of acceleration. Counted from the ramp's
    beginning, the acceleration builds up until T₂, begins to decrease at T₁, and is 0 from T₁ + T₂
    on. Ramps may have begun before time 0.

    Tested against a numerical convolution of the path.

    Args:
        time: Times in ascending order from the start of the motion, shape (k,) [s].
        start: Cylinder lengths at time 0, shape (n,) [m].
        speed: Piston speeds before the first ramp, shape (n,) [m/s].
        at: Time at which each ramp begins, shape (c,) [s].
        change: Change of the piston speeds in each ramp, shape (c, n) [m/s].
        rise: Time T₁ from the beginning of each ramp until its acceleration begins to fall, shape
            (c,) [s].
        blend: Time T₂ of each ramp, shape (c,) [s]. The acceleration rises for T₂ at the ramp's
            beginning, and falls for T₂ at its end.

    Returns:
        Cylinder lengths [m], piston speeds [m/s] and accelerations [m/s²], of shape (k, n).
    """
    rows, n = len(time), len(start)
    length, velocity = np.zeros((rows, n)), np.zeros((rows, n))
    acceleration, over, lag = np.zeros((rows, n)), np.zeros((rows, n)), np.zeros((rows, n))
    for i in range(len(at)):
        before, _, _ = evaluate_ramp(rise[i], blend[i], -at[i])
        duration = rise[i] + blend[i]
        k = 0
        while k < rows and time[k] <= at[i]:
            k += 1
        while k < rows and time[k] < at[i] + duration:
            way, share, rate = evaluate_ramp(rise[i], blend[i], time[k] - at[i])
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


@kernel
def _find_breaks_and_peaks(
    at: FloatArray, change: FloatArray, rise: FloatArray, blend: FloatArray
) -> tuple[FloatArray, float, float]:
    """Compute the breaks of a ramped motion, and its largest acceleration and jerk.

    Breaks are the times at which the jerk changes. Between two breaks the acceleration is linear,
    so the largest acceleration occurs at a break.

    Args:
        at: Time at which each ramp begins, shape (c,) [s].
        change: Change of the piston speeds in each ramp, shape (c, n) [m/s].
        rise: Time T₁ from the beginning of each ramp until its acceleration begins to fall, shape
            (c,) [s].
        blend: Time T₂ of each ramp, shape (c,) [s]. The acceleration rises for T₂ at the ramp's
            beginning, and falls for T₂ at its end.

    Returns:
        Ascending times of the breaks from 0 [s], and the largest absolute acceleration [m/s²] and
        jerk [m/s³] over all pistons.
    """
    time, still = _find_breaks(at, change, rise, blend), np.zeros(change.shape[1])
    _, _, acceleration = _sample_pistons(time, still, still, at, change, rise, blend)
    highest = steepest = 0.0
    for k in range(len(time)):
        for j in range(acceleration.shape[1]):
            highest = max(highest, abs(acceleration[k, j]))
            if k > 0:
                difference = acceleration[k, j] - acceleration[k - 1, j]
                steepest = max(steepest, abs(difference) / (time[k] - time[k - 1]))
    return time, highest, steepest
