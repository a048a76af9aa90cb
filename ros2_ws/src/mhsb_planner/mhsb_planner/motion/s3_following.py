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

from collections.abc import Iterator

import numpy as np

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
) -> RampedMotion:
    """A path's motion, with ramps like `ramp`, beginning at `delay` s.

    stretch  factor on the path's durations. Where the speed changes, times are rounded up to ticks
    first    another, shorter ramp, by which the path begins: with that of the coasting, speeds
             that stay do not sink in between. Ramps then have the middles that they would have if
             all were like it; those without room for that are like it
    """
    length, due, speed = _steps(machine, path, stretch)
    turns = np.abs(np.diff(speed, axis=0)).max(axis=1) > SAME_SPEED
    corners = np.flatnonzero(np.concatenate([[True], turns, [True]]))
    time = np.concatenate([[0.0], np.cumsum(due)])
    ticks = np.maximum(1.0, np.ceil(np.diff(time[corners]) / TICK - 1e-6))
    begin = delay + TICK * np.concatenate([[0.0], np.cumsum(ticks)])
    speed = np.diff(length[corners], axis=0) / (TICK * ticks)[:, None]
    rest = np.zeros((1, length.shape[1]))
    first = first or ramp
    sooner = 0.5 * (ramp.duration - first.duration)
    own_ramp = begin - sooner >= begin[0]
    own = RampedMotion(
        machine,
        path.posture[0],
        length[0],
        rest[0],
        np.where(own_ramp, begin - sooner, begin),
        np.diff(np.vstack([rest, speed, rest]), axis=0),
        np.where(own_ramp, ramp.rise, first.rise),
        np.where(own_ramp, ramp.blend, first.blend),
        np.interp(time, time[corners], begin) + 0.5 * first.duration,
    )
    return own if coast is None else coast.motion.plus(own)


def _steps(
    machine: Machine, path: DiscretePath, stretch: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Cylinder lengths [m] at the points of a path, the steps' durations [s] and speeds [m/s]."""
    length = lengths_of(machine.arrays, path.posture)
    due = stretch * np.maximum(path.duration, SHORTEST_STEP)
    return length, due, np.diff(length, axis=0) / due[:, None]


def followed_path(
    machine: Machine,
    path: DiscretePath,
    slower: float,
    coast: Coasting | None,
    stretch: float,
) -> RampedMotion:
    """The shortest of a path's motions within acceleration and jerk, or the last one tried.

    slower: factor on the duration of the shortest ramps, where the path has them at all.
    """
    tried = _ever_slower(machine, path, slower, coast, stretch)
    motion = next(tried)
    while not motion.gentle:
        slowed = next(tried, None)
        if slowed is None:
            break
        motion = slowed
    return motion


def _ever_slower(
    machine: Machine, path: DiscretePath, slower: float, coast: Coasting | None, stretch: float
) -> Iterator[RampedMotion]:
    """From a moving start the path sets out at once, then ever later; then ramps become slower."""
    _, _, speed = _steps(machine, path, stretch)
    ramp, delay = shortest_ramp(machine, float(np.abs(speed).max())).slower(slower, slower), 0.0
    if coast is not None:
        ramp = max(ramp, coast.ramp, key=lambda each: each.duration)
        rise, delay = coast.ramp.rise, coast.told + coast.ramp.duration
        even = ramp.in_step_with(coast.ramp)
        yield following_motion(machine, path, even, stretch, coast, coast.told, coast.ramp)
        for longer in AT_ONCE:
            slow = ramp.slower(longer, longer)
            yield following_motion(machine, path, slow, stretch, coast, coast.told)
        for later in (whole_ticks(0.5 * rise), rise):
            yield following_motion(machine, path, ramp, stretch, coast, coast.told + later)
    for _ in range(ROUNDS):
        motion = following_motion(machine, path, ramp, stretch, coast, delay)
        yield motion
        acceleration, jerk = (max(1.0, peak) for peak in motion.peaks)
        ramp = ramp.slower(acceleration, max(1.0, jerk / acceleration))
