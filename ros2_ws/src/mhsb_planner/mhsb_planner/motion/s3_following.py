"""Trajectories that follow a discrete path closely and so keep its cost (S3).

The discrete path has constant piston speeds in each step. Each change of speed becomes a ramp, a
change with limited acceleration and jerk (`s3_ramps`). This smooths the whole path by convolution
with one function k:

    L(t) = L₀ + Σᵢ Δvᵢ R(t − tᵢ),   v(t) = Σᵢ Δvᵢ ρ(t − tᵢ),   v̇(t) = Σᵢ Δvᵢ k(t − tᵢ)

L is the cylinder length and v the piston speed. Ramp i begins at tᵢ and changes the speed by Δvᵢ.
ρ is the integral of k, and R the integral of ρ.

Lengths and speeds are weighted means of lengths and speeds of the discrete path. Joint limits,
V_max and pump flows are therefore kept by construction. Acceleration and jerk are kept if the
changes of speed are not too close in time; otherwise the ramps are made slower. The motion lasts
one ramp longer than the path. If the arm moves at the start, its motion to rest (`s3_blend_in`) is
added to the motion along the path. The path begins at once, or a little later if the acceleration
would be too large.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.linkages.linkage import cylinder_lengths
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray
from mhsb_planner.motion.ramped_motion import RampedMotion
from mhsb_planner.motion.s3_blend_in import Coasting
from mhsb_planner.motion.s3_polynomial import MIN_STEP_DURATION
from mhsb_planner.motion.s3_ramps import (
    RAMP_TIME_STEP,
    Ramp,
    compute_shortest_ramp,
    round_up_to_time_step,
)
from mhsb_planner.search.discrete_path import DiscretePath

SAME_SPEED = 1e-7
"""Difference up to which the piston speeds of two adjacent steps count as equal [m/s]."""

RAMP_DURATION_FACTORS = (1.0, 1.5, 2.5)
"""Factors on the duration of ramps, for a path that begins while the pistons still move [-].

They are tried in this order.
"""

MAX_SLOWING_ROUNDS = 6
"""Largest number of motions from rest that are tried, each with slower ramps."""


class PistonPath(NamedTuple):
    """Discrete path of k steps, given by cylinder lengths and durations.

    Attributes:
        machine: Machine that moves.
        start: Joint positions at the first node, shape (n,) [rad or m].
        length: Cylinder lengths at the nodes, shape (k + 1, n) [m].
        duration: Duration of each step, at least MIN_STEP_DURATION, shape (k,) [s].
    """

    machine: Machine
    start: FloatArray
    length: FloatArray
    duration: FloatArray

    @classmethod
    def create(cls, machine: Machine, path: DiscretePath, scale: FloatArray | float) -> PistonPath:
        """Compute the cylinder lengths and the durations of a path.

        Args:
            machine: Machine that moves.
            path: Discrete path.
            scale: Factor on the durations of all steps, or of each step, shape (k,) [-].

        Returns:
            The path of the pistons.
        """
        length = cylinder_lengths(machine.arrays.linkage, path.posture)
        duration = scale * np.maximum(path.duration, MIN_STEP_DURATION)
        return cls(machine, path.posture[0], length, duration)


class PathBeginning(NamedTuple):
    """Time and ramp (smooth change of speed) with which the motion along a path begins.

    Attributes:
        coast: Motion that brings a moving arm to rest. It is added to the motion along the path.
            None if the arm is at rest.
        delay: Time at which the path's first ramp begins [s].
        ramp: Shorter ramp with which the path begins; None means the ramp of all other changes of
            speed. If it equals the ramp to rest of `coast`, a piston with the same speed before and
            after does not slow down in between. All ramps are placed by their middles, computed as
            if each were this ramp. A longer ramp that would begin before `delay` is replaced by
            this ramp.
    """

    coast: Coasting | None = None
    delay: float = 0.0
    ramp: Ramp | None = None


FROM_REST = PathBeginning()
"""Beginning of a path at time 0, from rest."""


def smooth_path(
    path: PistonPath,
    ramp: Ramp,
    beginning: PathBeginning = FROM_REST,
    last_ramp_factor: float = 1.0,
) -> RampedMotion:
    """Smooth a path of the pistons: each change of speed becomes a ramp.

    A ramp changes the speeds within limited acceleration and jerk. The times between changes of
    speed are rounded up to multiples of RAMP_TIME_STEP.

    Args:
        path: Path of the pistons.
        ramp: Ramp of all changes of speed.
        beginning: Time and ramp with which the path begins. Its `coast`, the motion by which a
            moving arm comes to rest, is added to the motion along the path.
        last_ramp_factor: Factor on the duration of the last ramp [-]. The middle of the ramp stays
            at the same time.

    Returns:
        Motion of the pistons. It begins at the start of `beginning.coast`, or at the path's first
        posture if `beginning.coast` is None.
    """
    machine, start, length, duration = path
    coast, delay, first_ramp = beginning
    at, change, rise, blend, node_time = _place_ramps(
        length, duration, delay, *ramp, *(first_ramp or ramp)
    )
    if last_ramp_factor != 1.0:
        before = Ramp(float(rise[-1]), float(blend[-1]))
        ending = before.scale(last_ramp_factor, last_ramp_factor).align_with(before)
        at[-1] += 0.5 * (before.duration - ending.duration)
        rise[-1], blend[-1] = ending
    rest = np.zeros(length.shape[1])
    own = RampedMotion(machine, start, length[0], rest, at, change, rise, blend, node_time)
    return own if coast is None else coast.motion.superpose(own)


@kernel
def find_highest_speed(length: FloatArray, duration: FloatArray) -> float:
    """Find the highest piston speed in the steps of a path.

    Args:
        length: Cylinder lengths at the nodes, shape (k + 1, n) [m].
        duration: Durations of the steps, shape (k,) [s].

    Returns:
        Speed [m/s].
    """
    highest = 0.0
    for k in range(len(duration)):
        for j in range(length.shape[1]):
            highest = max(highest, abs(length[k + 1, j] - length[k, j]) / duration[k])
    return highest


@kernel
def _place_ramps(
    length: FloatArray,
    due: FloatArray,
    delay: float,
    rise: float,
    blend: float,
    first_rise: float,
    first_blend: float,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Place a ramp (smooth change of speed) at each node of a path at which piston speeds change.

    The path's first and last node have a ramp, too. Adjacent steps of equal speeds are merged. The
    time between the middles of two ramps is rounded up to a multiple of RAMP_TIME_STEP, and the
    speeds are lowered accordingly. A ramp has two times, T₁ ≥ T₂. Its acceleration builds up until
    T₂, begins to decrease at T₁, and is 0 from T₁ + T₂ on.

    The first ramp begins at `delay` and has the times `first_rise` and `first_blend`. The middles
    of all ramps are computed with the times of the first ramp. The other ramps then get the times
    `rise` and `blend`, around the same middles. If a ramp would then begin before `delay`, it keeps
    the times of the first ramp.

    Args:
        length: Cylinder lengths at the path's nodes, shape (k + 1, n) [m].
        due: Durations of the path's steps, shape (k,) [s].
        delay: Earliest time at which a ramp begins [s].
        rise: Common time T₁ of the ramps [s].
        blend: Common time T₂ of the ramps [s].
        first_rise: Time T₁ of the first ramp [s].
        first_blend: Time T₂ of the first ramp [s].

    Returns:
        For each of the c ramps: begin, shape (c,) [s]; change of the piston speeds, shape (c, n)
        [m/s]; T₁, shape (c,) [s]; and T₂, shape (c,) [s]. Last, the time at which the motion is to
        be at each node, shape (k + 1,) [s]. For a node with a ramp this is the middle of the ramp.
    """
    steps, n = len(due), length.shape[1]
    corner, count = np.zeros(steps + 1, dtype=np.int64), 0  # nodes at which the speeds change
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
        whole = max(1.0, math.ceil(span / RAMP_TIME_STEP - 1e-6))
        lasts = RAMP_TIME_STEP * whole
        since = 0.0
        for k in range(corner[i], corner[i + 1]):
            node_time[k] = begin + lasts * since / span + 0.5 * first
            since += due[k]
        for j in range(n):
            speed = (length[corner[i + 1], j] - length[corner[i], j]) / lasts
            change[i, j] += speed
            change[i + 1, j] -= speed
        ticks += whole
        begin = delay + RAMP_TIME_STEP * ticks
    return at, change, rises, blends, node_time


def compute_followed_path(
    machine: Machine,
    path: DiscretePath,
    ramp_factor: float,
    coast: Coasting | None,
    scale: FloatArray | float,
    last_ramp_factor: float = 1.0,
) -> RampedMotion:
    """Compute a motion along a discrete path, within the limits of piston acceleration and jerk.

    Each change of the piston speeds is a ramp (smooth change). Motions with longer and longer ramps
    are tried until one keeps the limits. The first motion's ramps are the shortest that reach the
    path's highest piston speed, times `ramp_factor`. If the arm moves at the start, the path begins
    during `coast` in the first motions, and after `coast` in later motions.

    Args:
        machine: Machine that moves.
        path: Discrete path.
        ramp_factor: Factor on the duration of the first motion's ramps [-]; may be below 1.
        coast: Motion that brings a moving arm to rest. None if the arm is at rest.
        scale: Factor on the durations of all steps, or of each step, shape (k,) [-].
        last_ramp_factor: Further factor on the duration of the last ramp [-]; may be below 1.

    Returns:
        First motion within the limits. If there is none, the last motion tried; its
        `keeps_dynamic_limits` is False.
    """
    pistons = PistonPath.create(machine, path, scale)
    for motion in _iterate_slower_motions(pistons, ramp_factor, coast, last_ramp_factor):
        if motion.keeps_dynamic_limits:
            break
    return motion


def _iterate_slower_motions(
    path: PistonPath, slower: float, coast: Coasting | None, last: float
) -> Iterator[RampedMotion]:
    """Yield motions along a path with ever longer ramps (smooth changes of speed).

    If the arm moves at the start, the path begins before the pistons are at rest in the first
    motions:

    1. One motion whose path begins with a ramp as long as the pistons' ramp to rest. So a piston
       that keeps its speed does not slow down in between.
    2. One motion for each factor of RAMP_DURATION_FACTORS on the ramps.
    3. Two motions whose path begins a little later.

    Then MAX_SLOWING_ROUNDS motions follow in which the path begins from rest. The ramps of a motion
    are longer by the factors by which the previous motion exceeds the limits.

    Args:
        path: Path of the pistons.
        slower: Factor on the duration of the shortest ramps [-].
        coast: Motion that brings a moving arm to rest. None if the arm is at rest.
        last: Further factor on the duration of the last ramp [-].

    Yields:
        Motions of the pistons. Any of them may exceed the limits.
    """
    fastest = find_highest_speed(path.length, path.duration)
    ramp, delay = compute_shortest_ramp(path.machine, fastest).scale(slower, slower), 0.0
    if coast is not None:
        ramp = max(ramp, coast.ramp, key=lambda each: each.duration)
        rise, delay = coast.ramp.rise, coast.stop_time + coast.ramp.duration
        even = ramp.align_with(coast.ramp)
        at_once = PathBeginning(coast, coast.stop_time)
        sharing_ramp = at_once._replace(ramp=coast.ramp)
        yield smooth_path(path, even, sharing_ramp, last)
        for longer in RAMP_DURATION_FACTORS:
            slow = ramp.scale(longer, longer)
            yield smooth_path(path, slow, at_once, last)
        for later in (round_up_to_time_step(0.5 * rise), rise):
            begun = PathBeginning(coast, coast.stop_time + later)
            yield smooth_path(path, ramp, begun, last)
    for _ in range(MAX_SLOWING_ROUNDS):
        motion = smooth_path(path, ramp, PathBeginning(coast, delay), last)
        yield motion
        acceleration, jerk = (max(1.0, peak) for peak in motion.peaks)
        ramp = ramp.scale(acceleration, max(1.0, jerk / acceleration))
