"""Slowing of a motion, or of pieces of it, if pumps, valves or pressures do not suffice.

A motion along a discrete path has a factor on the duration of each step. If a limit is broken at
some instants, only the factors of the steps around these instants become larger.
"""

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray, ModeArray
from mhsb_planner.motion.limits.limit import TimeScaling, Violation
from mhsb_planner.motion.limits.thrust import THRUST_LIMIT, find_inertia_excess
from mhsb_planner.motion.motion_profile import MotionProfile
from mhsb_planner.motion.s3_limits import EndValues

THRUST_STRETCH, PIECE_THRUST_STRETCH = 1.25, 1.5
"""Factor on the duration of a motion, and of a piece of it, if the pressure is too low [-].

The first factor reduces the inertia forces by a third. A piece is short, so a larger factor costs
little time and needs fewer rounds."""

MIN_PIECE_FACTOR = 1.02
"""Least factor by which a piece is slowed alone [-].

A piece that is slowed alone adds changes of speed to the motion, and the times between changes of
speed are rounded up. Below this factor, slowing the whole motion costs less time."""

USAGE_RESERVE = 1.003
"""Reserve factor on durations that are chosen by the limits at the trajectory's points [-].

It covers higher values between the points."""

RAMP_RESERVE = 1.02
"""Reserve factor on the duration of ramps that is computed from the lack of pressure [-].

During longer ramps the pistons move farther, so that their loads differ slightly."""

MIN_RAMP_GROWTH, MAX_RAMP_GROWTH = 1.1, 2.0
"""Least and largest factor by which ramps become longer at once [-].

Smaller factors take many trials if the lack is between the points. Larger factors were computed up
to 20 % too large, since modes and loads change with the ramps."""


def compute_ramp_growth(
    machine: Machine, profile: MotionProfile, middles: MotionProfile, modes: ModeArray
) -> float:
    """Compute the factor by which ramps must become longer for the pressure to suffice.

    A ramp is a change of piston speed. Inertia forces are inversely proportional to its duration.

    Args:
        machine: Machine that moves.
        profile: Profile (piston speeds and forces) at the k + 1 points of the motion.
        middles: Profile at the middles between the points.
        modes: Mode codes between the points, shape (k, n).

    Returns:
        RAMP_RESERVE times the factor by which inertia forces are too large, but at least
        MIN_RAMP_GROWTH and at most MAX_RAMP_GROWTH [-].
    """
    excess = max(
        find_inertia_excess(machine.arrays, part.speed, part.force, part.inertia, modes)
        for part in (profile[:-1], middles, profile[1:])
    )
    return min(MAX_RAMP_GROWTH, max(MIN_RAMP_GROWTH, RAMP_RESERVE * excess))


def compute_needed_factors(
    violation: Violation,
    ends: EndValues,
    used: FloatArray,
    time: FloatArray,
    slows_pieces: bool,
) -> FloatArray:
    """Compute the factor by which each interval must become longer to remove a violation.

    The rule depends on the broken limit:

    - Pressure (TimeScaling.INERTIA): intervals with too low pressure get PIECE_THRUST_STRETCH if
      `slows_pieces`, else THRUST_STRETCH. All other intervals get 1.
    - V_max, valves or pumps (TimeScaling.SPEED): each interval gets USAGE_RESERVE times the share
      `used`. For the interval of the violation the share is 1 plus the excess of the violation.

    Args:
        violation: The broken limit, its time and its excess over the limit.
        ends: Quantities of the limits at the ends of the k intervals.
        used: Share of V_max, valves and pumps that each interval uses, shape (k,) [-]; 1 is the
            most that is allowed.
        time: Times of the motion's points, shape (k + 1,) [s].
        slows_pieces: True if only the steps around the violation become longer.

    Returns:
        Factor on the duration of each interval, shape (k,) [-]. It is below 1 if V_max, valves and
        pumps would allow a shorter duration.
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
    """Compute the factor on the duration of each path step from the factors of intervals.

    If `slows_pieces` is False, or if the largest factor is at most MIN_PIECE_FACTOR, all steps get
    the largest factor. Otherwise the factor of each interval is assigned to the path node nearest
    in time. Each step then gets the larger factor of its two nodes, at least 1.

    Args:
        needed: Factor that each interval of the motion needs, shape (m,) [-].
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
