"""Ramps: how a piston passes from one constant speed to another within acceleration and jerk.

A ramp is the step of speed smoothed by k = box(T₁) * box(T₂), T₁ ≥ T₂: the acceleration Δv k(t) is
a trapezoid of height Δv/T₁ and slope Δv/(T₁T₂), and lasts T₁ + T₂. k is even about its middle and
its integral is 1, so that motions made of ramps are weighted means of the unsmoothed ones.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine

SHARE = 0.5
"""Of the acceleration and the jerk that are allowed a ramp takes so much: another one may be going
on, at a start that changes its speed already."""

TICK = 1e-3
"""Times of ramps are whole multiples of this [s], so that a motion's points are no closer."""


class Ramp(NamedTuple):
    """Times of a ramp [s].

    rise   T₁, from the beginning of the acceleration to the beginning of its end
    blend  T₂ ≤ T₁, in which the acceleration builds up, and in which it fades
    """

    rise: float
    blend: float

    @property
    def duration(self) -> float:
        """From one constant speed to the other [s]."""
        return self.rise + self.blend

    def slower(self, rise: float, blend: float) -> Ramp:
        """A ramp whose times are longer by these factors."""
        rise, blend = rise * self.rise, blend * self.blend
        return Ramp(whole_ticks(max(rise, blend)), whole_ticks(min(rise, blend)))

    def in_step_with(self, other: Ramp) -> Ramp:
        """This ramp, or one a tick longer: so that both's middles are whole ticks apart."""
        odd = round((self.duration - other.duration) / TICK) % 2
        return Ramp(self.rise + odd * TICK, self.blend)


def whole_ticks(seconds: float) -> float:
    """The next whole multiple of TICK, at least one."""
    return max(1, math.ceil(seconds / TICK - 1e-6)) * TICK


def shortest_ramp(machine: Machine, speed: float = math.inf) -> Ramp:
    """The ramp from rest to a speed V [m/s], at most the fastest piston's V_max: T₁ = V/a,
    T₂ = a/j, with a SHARE of a_max and j_max; T₁ = T₂ = √(V/j) where the jerk does not let the
    acceleration build up so far.
    """
    m = machine.arrays
    speed = min(speed, float(m.max_piston_speed.max()))
    acceleration, jerk = SHARE * m.max_piston_acceleration, SHARE * m.max_piston_jerk
    rise, blend = speed / acceleration, acceleration / jerk
    if blend > rise:
        rise = blend = math.sqrt(speed / jerk)
    return Ramp(whole_ticks(rise), whole_ticks(blend))


@kernel
def ramp_at(rise: float, blend: float, t: float) -> tuple[float, float, float]:
    """∫ρ dt [s], ρ = ∫k dt and k [1/s] of a ramp from speed 0 to 1, t s after it began.

    Oracle: the same convolution done numerically.
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
def ramp_time(rise: float, blend: float, ratio: float) -> float:
    """When ρ/k of a ramp is `ratio` [s]; it grows from 0 without bound."""
    if ratio < 0.5 * blend:
        return 2.0 * ratio
    if ratio <= rise - 0.5 * blend:
        return ratio + 0.5 * blend
    product = 2.0 * rise * blend
    return rise + blend - product / (ratio + math.sqrt(ratio * ratio + product))
