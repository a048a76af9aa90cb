"""Ramps: transitions of a piston between two constant speeds within acceleration and jerk limits.

A ramp is a step of the speed by Δv, smoothed by convolution with k = box(T₁) * box(T₂). box(T) is a
rectangle of width T and area 1, * is the convolution, and T₁ ≥ T₂. The acceleration Δv k(t) is a
trapezoid that lasts T₁ + T₂. It builds up until T₂ with the slope Δv/(T₁T₂), stays at Δv/T₁ until
T₁, and then decreases. k is symmetric about its middle, and its integral is 1. So positions and
speeds of a motion with ramps are weighted means of positions and speeds of the motion without
ramps.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine

RAMP_LIMIT_SHARE = 0.5
"""Share of the allowed acceleration and jerk that one ramp takes [-].

The rest is left for a second ramp at the same time, which is needed if the arm is already changing
its speed at the start."""

RAMP_TIME_STEP = 1e-3
"""Time step of ramps [s].

Times of ramps are multiples of this step, so that the points of a motion are at least one step
apart."""


class Ramp(NamedTuple):
    """Times of a ramp.

    Attributes:
        rise: Time T₁ from the ramp's beginning until its acceleration begins to fall [s].
        blend: Time T₂ ≤ T₁ [s]. The acceleration rises for T₂ at the ramp's beginning, and falls
            for T₂ at its end.
    """

    rise: float
    blend: float

    @property
    def duration(self) -> float:
        """Time from one constant speed to the other, T₁ + T₂ [s]."""
        return self.rise + self.blend

    def scale(self, rise: float, blend: float) -> Ramp:
        """Return a ramp whose times T₁ and T₂ are multiplied by two factors.

        The times are rounded up to multiples of RAMP_TIME_STEP. If T₂ would be longer than T₁, the
        two times are exchanged.

        Args:
            rise: Factor on T₁ [-].
            blend: Factor on T₂ [-].

        Returns:
            The new ramp.
        """
        rise, blend = rise * self.rise, blend * self.blend
        return Ramp(
            round_up_to_time_step(max(rise, blend)), round_up_to_time_step(min(rise, blend))
        )

    def align_with(self, other: Ramp) -> Ramp:
        """Return a ramp that can have a common middle with another ramp at whole time steps.

        If the durations differ by an odd number of time steps, T₁ becomes one step longer. Two
        ramps with a common middle then begin a whole number of time steps apart.

        Args:
            other: Ramp to compare with. Only `duration` is read.

        Returns:
            Ramp whose duration differs from the other ramp's by an even multiple of RAMP_TIME_STEP.
        """
        odd = round((self.duration - other.duration) / RAMP_TIME_STEP) % 2
        return Ramp(self.rise + odd * RAMP_TIME_STEP, self.blend)


def round_up_to_time_step(seconds: float) -> float:
    """Round a time up to a multiple of RAMP_TIME_STEP.

    Args:
        seconds: Time [s].

    Returns:
        The multiple, at least RAMP_TIME_STEP [s].
    """
    return max(1, math.ceil(seconds / RAMP_TIME_STEP - 1e-6)) * RAMP_TIME_STEP


def compute_shortest_ramp(machine: Machine, speed: float = math.inf) -> Ramp:
    """Compute the shortest ramp (smooth change of a piston's speed) from rest to a speed.

        T₁ = V/a,  T₂ = a/j

    T₁ is the time until the acceleration begins to decrease, T₂ the time in which it builds up. a
    and j are RAMP_LIMIT_SHARE of the allowed acceleration and jerk. If T₂ would exceed T₁, the
    acceleration does not build up to a, and T₁ = T₂ = √(V/j). Times are rounded up to multiples of
    RAMP_TIME_STEP.

    Args:
        machine: Machine whose piston acceleration and jerk are the limits.
        speed: Speed V [m/s]. A higher speed than the largest V_max of all pistons counts as this
            V_max.

    Returns:
        The ramp.
    """
    m = machine.arrays
    speed = min(speed, max(m.max_piston_speed.tolist()))
    acceleration, jerk = (
        RAMP_LIMIT_SHARE * m.max_piston_acceleration,
        RAMP_LIMIT_SHARE * m.max_piston_jerk,
    )
    rise, blend = speed / acceleration, acceleration / jerk
    if blend > rise:
        rise = blend = math.sqrt(speed / jerk)
    return Ramp(round_up_to_time_step(rise), round_up_to_time_step(blend))


@kernel
def evaluate_ramp(rise: float, blend: float, t: float) -> tuple[float, float, float]:
    """Evaluate a ramp (smooth change of speed) from speed 0 to 1.

    ρ is the relative speed, R its integral and k its derivative. k builds up during T₂, begins to
    decrease at T₁, and is 0 again at T₁ + T₂. Before the ramp all three values are 0. After it R =
    t − (T₁ + T₂)/2, ρ = 1 and k = 0.

    Tested against a numerical convolution box(T₁) * box(T₂).

    Args:
        rise: Time T₁ from the ramp's beginning until its acceleration begins to fall [s].
        blend: Time T₂ ≤ T₁ [s]. The acceleration rises for T₂ at the ramp's beginning, and falls
            for T₂ at its end.
        t: Time since the ramp began [s].

    Returns:
        Integral R [s], relative speed ρ from 0 to 1 [-], and derivative k [1/s].
    """
    total = rise + blend
    if t <= 0.0:
        return 0.0, 0.0, 0.0
    if t >= total:
        return t - 0.5 * total, 1.0, 0.0
    if t < blend:
        slope = 1.0 / (rise * blend)
        return slope * t**3 / 6.0, 0.5 * slope * t**2, slope * t
    if t <= rise:
        since = t - 0.5 * blend
        return (0.5 * since**2 + blend**2 / 24.0) / rise, since / rise, 1.0 / rise
    left, slope = total - t, 1.0 / (rise * blend)
    return (
        t - 0.5 * total + slope * left**3 / 6.0,
        1.0 - 0.5 * slope * left**2,
        slope * left,
    )


@kernel
def find_ramp_time(rise: float, blend: float, ratio: float) -> float:
    """Find the time at which the ratio of speed to acceleration of a ramp has a given value.

    The ramp goes from speed 0 to 1; ρ is its speed and k its acceleration. The ratio ρ/k grows from
    0 without bound during the ramp.

    Args:
        rise: Time T₁ from the ramp's beginning until its acceleration begins to fall [s].
        blend: Time T₂ ≤ T₁ [s]. The acceleration rises for T₂ at the ramp's beginning, and falls
            for T₂ at its end.
        ratio: Value of ρ/k, not negative [s].

    Returns:
        Time since the ramp began [s].
    """
    if ratio < 0.5 * blend:
        return 2.0 * ratio
    if ratio <= rise - 0.5 * blend:
        return ratio + 0.5 * blend
    product = 2.0 * rise * blend
    return rise + blend - product / (ratio + math.sqrt(ratio * ratio + product))
