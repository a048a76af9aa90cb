"""Slowing of those pieces of a motion in which pumps, valves or pressures do not suffice.

A motion along a discrete path has a scale for each step: a factor on the step's duration. If a
limit is broken at some instants, only the steps around them become longer.
"""

from __future__ import annotations

import numpy as np

from mhsb_model.types import FloatArray
from mhsb_planner.motion.limits.limit import TimeScaling, Violation
from mhsb_planner.motion.limits.thrust import THRUST_LIMIT
from mhsb_planner.motion.s3_limits import EndValues

THRUST_STRETCH, PIECE_THRUST_STRETCH = 1.25, 1.5
"""Factor on a motion's duration, and on that of a piece of it, if pressure lacks [-].

With the first, inertia falls by a third. A piece is short, so a larger factor costs little there
and needs fewer rounds."""

MIN_PIECE_FACTOR = 1.02
"""Least factor by which a piece is slowed alone [-].

A piece that is slowed alone adds corners to the motion, and the time between two corners is rounded
up. To slow the whole motion by a smaller factor takes less time."""

USAGE_RESERVE = 1.003
"""Factor by which durations are stretched beyond the need at the points [-].
It covers what may happen between the points."""


def compute_needed_factors(
    violation: Violation,
    ends: EndValues,
    used: FloatArray,
    time: FloatArray,
    slows_pieces: bool,
) -> FloatArray:
    """Compute how much longer each interval of a motion has to be, to mend a broken limit.

    - A lack of pressure (TimeScaling.INERTIA): each interval with it needs a fixed factor, which is
      PIECE_THRUST_STRETCH if `slows_pieces`, else THRUST_STRETCH.
    - V_max, valves or pumps (TimeScaling.SPEED): each interval needs the share that it uses, times
      USAGE_RESERVE. For the interval of the violation, this share is 1 plus the excess.

    Args:
        violation: The broken limit, and the time and excess at which it is broken.
        ends: Quantities of the limits at the ends of the k intervals.
        used: Share of what V_max, valves and pumps can do that each interval uses, shape (k,) [-].
        time: Times of the motion's points, shape (k + 1,) [s].
        slows_pieces: True if only the steps around the violation become longer.

    Returns:
        Factor on the duration of each interval, shape (k,) [-]; below 1 if V_max, valves and pumps
        allow a shorter one.
    """
    broken = min(int(np.searchsorted(time, violation.time, "right")) - 1, len(used) - 1)
    if violation.limit.time_scaling is TimeScaling.INERTIA:
        stretch = PIECE_THRUST_STRETCH if slows_pieces else THRUST_STRETCH
        thrust = np.maximum(ends.begin.of(THRUST_LIMIT), ends.end.of(THRUST_LIMIT))
        needed = np.where(thrust > THRUST_LIMIT.broken_above, stretch, 1.0)
        needed[broken] = stretch
        return needed
    needed = USAGE_RESERVE * used
    needed[broken] = USAGE_RESERVE * (1.0 + violation.amount)
    return needed


def spread_over_steps(
    needed: FloatArray, time: FloatArray, node_time: FloatArray, slows_pieces: bool
) -> FloatArray:
    """Compute the factor on the duration of each path step from those of a motion's intervals.

    All steps get the largest factor if it is at most MIN_PIECE_FACTOR, or if `slows_pieces` is
    False. Otherwise the factor of each interval goes to the nearest node, and from there to the two
    steps that meet in it. Each step gets the largest of its factors, at least 1.

    Args:
        needed: Factor that each interval needs, shape (m,) [-].
        time: Times of the motion's points, shape (m + 1,) [s].
        node_time: Time at which the motion is to be at each node of the path, shape (k + 1,) [s].
        slows_pieces: True if steps may be slowed alone.

    Returns:
        Factor of each step, shape (k,) [-].
    """
    most = float(needed.max())
    if not slows_pieces or most <= MIN_PIECE_FACTOR:
        return np.full(len(node_time) - 1, most)
    halfway = 0.5 * (node_time[:-1] + node_time[1:])
    nearest = np.searchsorted(halfway, 0.5 * (time[:-1] + time[1:]))
    at_node = np.ones(len(node_time))
    np.maximum.at(at_node, nearest, needed)
    return np.maximum(at_node[:-1], at_node[1:])
