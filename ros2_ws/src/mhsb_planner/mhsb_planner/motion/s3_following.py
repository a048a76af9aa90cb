"""S3 that keeps what the discrete path promised: its motion in cylinder lengths, made of ramps.

The discrete path runs through its steps at constant piston speeds. Each change of speed becomes a
ramp (`s3_ramps`), which is to smooth the whole path with one kernel:

    L(t) = L₀ + Σᵢ Δvᵢ R(t − tᵢ),   v(t) = Σᵢ Δvᵢ ρ(t − tᵢ),   v̇(t) = Σᵢ Δvᵢ k(t − tᵢ)

Lengths and piston speeds are weighted means of the discrete ones, so that joint limits, V_max and
the pumps' flows hold by construction; acceleration and jerk hold as long as corners are not too
close, and where they are, the ramps are made slower. The motion lasts one ramp longer than the
path. From a moving start the coasting (`s3_coasting`) is added: the path then sets out at once,
or, where that would pass the acceleration, a little later.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray
from mhsb_planner.motion.piston_motion import lengths_of
from mhsb_planner.motion.ramped_motion import RampedMotion
from mhsb_planner.motion.s3_coasting import Coasting
from mhsb_planner.motion.s3_polynomial import SHORTEST_STEP
from mhsb_planner.motion.s3_ramps import TICK, Ramp, shortest_ramp, whole_ticks
from mhsb_planner.search.discrete_path import DiscretePath

SAME_SPEED = 1e-7
"""Speeds of a step and the next that differ by less are one [m/s]."""

AT_ONCE = (1.0, 1.5, 2.5)
"""Factors on the ramps of a path that sets out while a moving start still coasts."""

ROUNDS = 6
"""Times that ramps are made slower before the last is taken."""


def following_motion(
    machine: Machine,
    path: DiscretePath,
    ramp: Ramp,
    stretch: float,
    coast: Coasting | None = None,
    delay: float = 0.0,
    first: Ramp | None = None,
    last: float = 1.0,
) -> RampedMotion:
    """A path's motion, with ramps like `ramp`, beginning at `delay` s.

    stretch  factor on the path's durations. Where the speed changes, times are rounded up to ticks
    first    another, shorter ramp, by which the path begins: with that of the coasting, speeds
             that stay do not sink in between. Ramps then have the middles that they would have if
             all were like it; those without room for that are like it
    last     factor on the times of the last ramp, whose middle stays
    """
    length = lengths_of(machine.arrays, path.posture)
    first, due = first or ramp, _durations(path, stretch)
    at, change, rise, blend, node_time = _ramps(
        length, due, delay, ramp.rise, ramp.blend, first.rise, first.blend
    )
    if last != 1.0:
        before = Ramp(float(rise[-1]), float(blend[-1]))
        ending = before.slower(last, last).in_step_with(before)
        at[-1] += 0.5 * (before.duration - ending.duration)
        rise[-1], blend[-1] = ending
    rest = np.zeros(length.shape[1])
    own = RampedMotion(
        machine, path.posture[0], length[0], rest, at, change, rise, blend, node_time
    )
    return own if coast is None else coast.motion.plus(own)


def _durations(path: DiscretePath, stretch: float) -> FloatArray:
    """Of a path's steps [s]."""
    return stretch * np.maximum(path.duration, SHORTEST_STEP)


@kernel
def _ramps(
    length: FloatArray,
    due: FloatArray,
    delay: float,
    rise: float,
    blend: float,
    first_rise: float,
    first_blend: float,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """When ramps begin, their changes of speed, rises and blends, and when nodes are due.

    A ramp at each point of the path where the speed changes: due[k] are the steps' durations [s],
    length[k + 1, n] the cylinders' lengths [m]; the rest as of `following_motion`.
    """
    steps, n = len(due), length.shape[1]
    corner, count = np.zeros(steps + 1, dtype=np.int64), 0  # the points where speeds change
    for k in range(1, steps + 1):
        turns = k == steps
        for j in range(n):
            if not turns:
                before = (length[k, j] - length[k - 1, j]) / due[k - 1]
                turns = abs((length[k + 1, j] - length[k, j]) / due[k] - before) > SAME_SPEED
        if turns:
            count += 1
            corner[count] = k
    total, first = rise + blend, first_rise + first_blend
    sooner = 0.5 * (total - first)
    at, change, node_time = np.empty(count + 1), np.zeros((count + 1, n)), np.empty(steps + 1)
    rises, blends = np.empty(count + 1), np.empty(count + 1)
    begin, ticks = delay, 0.0
    for i in range(count + 1):
        own = begin - sooner >= delay
        at[i] = begin - sooner if own else begin
        rises[i], blends[i] = (rise, blend) if own else (first_rise, first_blend)
        node_time[corner[i]] = begin + 0.5 * first
        if i == count:
            break
        span = 0.0
        for k in range(corner[i], corner[i + 1]):
            span += due[k]
        whole = max(1.0, math.ceil(span / TICK - 1e-6))
        lasts = TICK * whole
        since = 0.0
        for k in range(corner[i], corner[i + 1]):
            node_time[k] = begin + lasts * since / span + 0.5 * first
            since += due[k]
        for j in range(n):
            speed = (length[corner[i + 1], j] - length[corner[i], j]) / lasts
            change[i, j] += speed
            change[i + 1, j] -= speed
        ticks += whole
        begin = delay + TICK * ticks
    return at, change, rises, blends, node_time


def followed_path(
    machine: Machine,
    path: DiscretePath,
    slower: float,
    coast: Coasting | None,
    stretch: float,
    last: float = 1.0,
) -> RampedMotion:
    """The shortest of a path's motions within acceleration and jerk, or the last one tried.

    slower: factor on the duration of the shortest ramps, where the path has them at all; last:
    further one, on that of the last ramp.
    """
    tried = _ever_slower(machine, path, slower, coast, stretch, last)
    motion = next(tried)
    while not motion.gentle:
        slowed = next(tried, None)
        if slowed is None:
            break
        motion = slowed
    return motion


def _ever_slower(
    machine: Machine,
    path: DiscretePath,
    slower: float,
    coast: Coasting | None,
    stretch: float,
    last: float,
) -> Iterator[RampedMotion]:
    """From a moving start the path sets out at once, then ever later; then ramps become slower."""
    stroke = np.abs(np.diff(lengths_of(machine.arrays, path.posture), axis=0)).max(axis=1)
    fastest = float(np.max(stroke / _durations(path, stretch)))
    ramp, delay = shortest_ramp(machine, fastest).slower(slower, slower), 0.0
    if coast is not None:
        ramp = max(ramp, coast.ramp, key=lambda each: each.duration)
        rise, delay = coast.ramp.rise, coast.told + coast.ramp.duration
        even = ramp.in_step_with(coast.ramp)
        yield following_motion(machine, path, even, stretch, coast, coast.told, coast.ramp, last)
        for longer in AT_ONCE:
            slow = ramp.slower(longer, longer)
            yield following_motion(machine, path, slow, stretch, coast, coast.told, None, last)
        for later in (whole_ticks(0.5 * rise), rise):
            told = coast.told + later
            yield following_motion(machine, path, ramp, stretch, coast, told, None, last)
    for _ in range(ROUNDS):
        motion = following_motion(machine, path, ramp, stretch, coast, delay, None, last)
        yield motion
        acceleration, jerk = (max(1.0, peak) for peak in motion.peaks)
        ramp = ramp.slower(acceleration, max(1.0, jerk / acceleration))
