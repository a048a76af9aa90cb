"""How a slew's way is shared out over the steps of a path in the arm's plane.

At one speed, as far as V_max and what the main pump has left in each step allow; where that is not
enough, all steps take longer by one factor λ:

    sᵢ = min(v λtᵢ, V_max λtᵢ, (Q λtᵢ − Vᵢ)/A),  Σ sᵢ = |ΔL|,  Q = Q_MP − n q_leak

with the steps' durations tᵢ and the oil Vᵢ that they take, and of the slew its piston's way |ΔL|
and area A.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mhsb_model.linkages.linkage import cylinder_length
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray
from mhsb_planner.planners.path_planner import Meanwhile

HALVINGS = 50
"""Of the interval in which a speed or a factor is known to be."""

NOTHING = 1e-9
"""A way of the slew's piston that is rounding [m]."""


def slew_way(machine: Machine, began: float, ended: float) -> float:
    """How far the slew's piston goes between two of its angles [rad], |ΔL| [m]."""
    row = machine.arrays.linkage[0]
    return abs(cylinder_length(row, float(ended)) - cylinder_length(row, float(began)))


def slewing_meanwhile(machine: Machine, began: float, ended: float) -> Meanwhile:
    """What slewing between two angles [rad] takes: A |ΔL|, and |ΔL|/V_max at least."""
    way, m = slew_way(machine, began, ended), machine.arrays
    return Meanwhile(float(m.cap_area[0] * way), float(way / m.max_piston_speed[0]))


def path_oil(machine: Machine, posture: FloatArray) -> FloatArray:
    """Σ A_dir |ΔL| between each of the postures float64[k + 1, n] and the next, float64[k] m³."""
    a = machine.arrays
    way = np.diff([machine.cylinder_lengths(q) for q in posture], axis=0)
    return np.where(way > 0.0, a.cap_area * way, -a.rod_area * way).sum(axis=1)


def shared_out(
    way: float, duration: FloatArray, oil: FloatArray, fastest: float, flow: float, area: float
) -> tuple[FloatArray, FloatArray]:
    """What of its way [m] the slew's piston goes in each step, and how long that lasts [s].

    duration [s] and oil [m³] of the steps float64[k] without it; its V_max [m/s] and area [m²], and
    the flow [m³/s] that it shares with them. See the module.
    """

    def most(factor: float) -> FloatArray:
        """That each step has room for, lasting so many times as long."""
        left = np.maximum(flow * factor * steps - oil, 0.0) / area
        return np.minimum(fastest * factor * steps, left)

    if len(duration) == 0:
        return np.zeros(0), duration
    steps, longer = duration, 1.0
    if not duration.any():
        steps = np.full(len(duration), way / len(duration) / min(fastest, flow / area))
    elif most(1.0).sum() < way:  # some share of V_max and of the flow is always left
        enough = 1.0 + (way / min(fastest, flow / area) + oil.sum() / flow) / duration.sum()
        longer = _least(lambda factor: most(factor).sum() >= way, 1.0, enough)
    room, steps = most(longer), longer * steps
    speed = _least(lambda v: np.minimum(v * steps, room).sum() >= way, 0.0, fastest)
    share = np.minimum(speed * steps, room)
    return share * (way / share.sum() if way > 0.0 else 0.0), steps


def _least(holds: Callable[[float], bool], low: float, high: float) -> float:
    """The least number from which on `holds`, known to lie between these."""
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high
