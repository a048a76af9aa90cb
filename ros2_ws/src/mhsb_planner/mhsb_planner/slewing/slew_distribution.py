"""Distribution of a slew's stroke over the steps of a path in the arm's plane.

The slew's piston moves at one speed v in all steps. It is slower only in steps in which its largest
speed V_max or the remaining flow of the main pump is below v. If the path takes too little time for
the whole stroke, the durations of all steps are multiplied by one factor λ:

    sᵢ = min(v λtᵢ, V_max λtᵢ, (Q λtᵢ − Vᵢ)/A),  Σ sᵢ = |ΔL|,  Q = Q_MP − n q_leak

tᵢ [s] and Vᵢ [m³] are duration and oil volume of path step i without the slew. sᵢ [m] is the stroke
of the slew's piston in this step, |ΔL| its whole stroke and A its area. Q is the flow of the main
pump Q_MP minus the leakage q_leak of n valves [m³/s].
"""

from collections.abc import Callable

import numpy as np

from mhsb_model.linkages.linkage import cylinder_length
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray
from mhsb_planner.planners.path_planner import SlewDemand

BISECTION_STEPS = 50
"""Number of halvings of the interval in a bisection."""

STROKE_ROUNDING = 1e-9
"""Stroke of the slew's piston up to which the slew counts as resting [m]."""


def compute_slew_stroke(machine: Machine, start_angle: float, end_angle: float) -> float:
    """Compute the stroke |ΔL| of the slew's piston between two slew angles.

    Args:
        machine: Machine that slews.
        start_angle: Slew angle at the start [rad].
        end_angle: Slew angle at the end [rad].

    Returns:
        Stroke ≥ 0 [m].
    """
    row = machine.arrays.linkage[0]
    return abs(cylinder_length(row, float(end_angle)) - cylinder_length(row, float(start_angle)))


def compute_slew_demand(machine: Machine, start_angle: float, end_angle: float) -> SlewDemand:
    """Compute the oil volume and the least time of a slew from one angle to another.

    Args:
        machine: Machine that slews.
        start_angle: Slew angle at the start [rad].
        end_angle: Slew angle at the end [rad].

    Returns:
        Oil volume A |ΔL| [m³] and least time |ΔL|/V_max [s], with stroke |ΔL|, cap-side area A and
        largest speed V_max of the slew's piston.
    """
    way, m = compute_slew_stroke(machine, start_angle, end_angle), machine.arrays
    return SlewDemand(float(m.cap_area[0] * way), float(way / m.max_piston_speed[0]))


def compute_path_oil(machine: Machine, posture: FloatArray) -> FloatArray:
    """Compute the oil volume that the cylinders take in each step of a path.

    The volume is the sum of piston area times stroke over all cylinders. The cap-side area counts
    for a cylinder that extends, the rod-side area for a cylinder that retracts.

    Args:
        machine: Machine whose cylinders move, with n joints.
        posture: Postures of the path, float64[k + 1, n], [rad or m].

    Returns:
        Volume of each step, float64[k], [m³].
    """
    a = machine.arrays
    way = np.diff([machine.cylinder_lengths(q) for q in posture], axis=0)
    return np.where(way > 0.0, a.cap_area * way, -a.rod_area * way).sum(axis=1)


def distribute_stroke(
    stroke: float, duration: FloatArray, oil: FloatArray, max_speed: float, flow: float, area: float
) -> tuple[FloatArray, FloatArray]:
    """Distribute the slew's stroke over the steps of a path.

    The slew's piston has the same speed in all steps, except in steps in which V_max or the flow
    only allows a lower speed. If the durations are too short for the whole stroke, all of them are
    multiplied by one factor. Speed and factor are found by bisection.

    If all durations are 0, the steps get equal strokes, and equal durations that suffice for them.
    If there are no steps, both results are empty.

    Args:
        stroke: Whole stroke of the slew's piston, ≥ 0 [m].
        duration: Duration of each step without the slew, float64[k], [s].
        oil: Oil volume of each step without the slew, float64[k], [m³].
        max_speed: Largest piston speed V_max of the slew [m/s].
        flow: Flow of the main pump that the slew and the other joints share [m³/s].
        area: Piston area of the slew [m²].

    Returns:
        Stroke of the slew in each step [m], and new duration of each step [s], both float64[k].
    """

    def compute_largest_strokes(factor: float) -> FloatArray:
        """Compute the largest stroke of the slew in each step for a factor on all durations.

        V_max and the flow that the other joints leave limit the stroke.

        Args:
            factor: Factor on all durations [-].

        Returns:
            Largest stroke in each step, float64[k], [m].
        """
        left = np.maximum(flow * factor * steps - oil, 0.0) / area
        return np.minimum(max_speed * factor * steps, left)

    if len(duration) == 0:
        return np.zeros(0), duration
    steps, longer = duration, 1.0
    if not duration.any():
        steps = np.full(len(duration), stroke / len(duration) / min(max_speed, flow / area))
    elif compute_largest_strokes(1.0).sum() < stroke:
        # This factor adds the time that the slew takes alone, and that of the path's oil.
        sufficient = (
            1.0 + (stroke / min(max_speed, flow / area) + oil.sum() / flow) / duration.sum()
        )
        longer = _find_least(
            lambda factor: compute_largest_strokes(factor).sum() >= stroke, 1.0, sufficient
        )
    room, steps = compute_largest_strokes(longer), longer * steps
    speed = _find_least(lambda v: np.minimum(v * steps, room).sum() >= stroke, 0.0, max_speed)
    share = np.minimum(speed * steps, room)
    return share * (stroke / share.sum() if stroke > 0.0 else 0.0), steps


def _find_least(holds: Callable[[float], bool], low: float, high: float) -> float:
    """Find the least number for which a monotone condition holds, by bisection.

    Args:
        holds: Condition; if it holds for one number, it must hold for all larger numbers.
        low: Number at or below the least number.
        high: Number for which the condition holds.

    Returns:
        Number for which the condition holds. It exceeds the least such number by at most (high −
        low)/2^BISECTION_STEPS.
    """
    for _ in range(BISECTION_STEPS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high
