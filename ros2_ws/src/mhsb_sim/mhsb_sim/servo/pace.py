"""Pace: how fast the reference passes along its way, so that a guard may slow it down.

A plan is followed by its own time τ, with τ̇ = s the rate, 1 unless it is slowed:

    q = Q(τ),  q̇ = Q′ s,  q̈ = Q″ s² + Q′ ṡ

so that every posture is one of the plan, passed no faster than there. The delay t − τ stays until
the plan has come to its end; there τ catches up, twice as fast as t, so that it skips no plan that
is about to begin. Source: path-velocity decomposition, Siciliano et al., Robotics, Section 4.3.
"""

from __future__ import annotations

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.trajectory import SECOND_NS
from mhsb_sim.records import Record, Records

PACE = np.dtype(
    [
        ("rate", "f8"),  # s
        ("change", "f8"),  # ṡ, 1/s
        ("delay", "f8"),  # t − τ, ns
        ("rests", "f8"),  # 1 where the plan has come to its end
    ]
)

STIFFNESS = 40.0
"""ω of the rate's way to the one wanted, without overshoot [rad/s]."""

FASTEST_SLOWING = 8.0
"""Largest −ṡ [1/s]: from 12 mm/s a piston is decelerated by less than 0.1 m/s²."""

FASTEST_RECOVERY = 2.0
"""Largest ṡ [1/s]."""

FASTEST_TURN = 200.0
"""Largest |s̈| [1/s²]: what braking takes off a line's need, its pumps have 40 ms to follow."""

NEARLY_FULL, NEARLY_NONE = 1e-3, 1e-4
"""1 − s below which a rate that is to be 1 is 1, and s below which one that is to be 0 is 0."""


def full_pace() -> Records:
    """PACE[1] of a reference that nothing has slowed."""
    pace = np.zeros(1, PACE)
    pace["rate"] = 1.0
    return pace


@kernel
def keep_pace(pace: Record, wanted: float, step: float) -> None:
    """Move the rate towards the wanted one (0 … 1) over a step [s]; ṡ stays continuous.

    s̈ = ω² (s_wanted − s) − 2 ω ṡ, with s̈ and ṡ within their limits and s within 0 … 1.
    """
    before, goal = pace.rate, wanted
    if pace.rests > 0.0:
        pace.rate, pace.change = 1.0, 0.0
        pace.delay = max(0.0, pace.delay - step * SECOND_NS)
        return
    if goal == 1.0 and before > 1.0 - NEARLY_FULL:
        pace.rate, pace.change = 1.0, 0.0
    elif goal == 0.0 and before < NEARLY_NONE:
        pace.rate = pace.change = 0.0
    else:
        jerk = STIFFNESS * (STIFFNESS * (goal - before) - 2.0 * pace.change)
        jerk = min(max(jerk, -FASTEST_TURN), FASTEST_TURN)
        change = pace.change + step * jerk
        pace.change = min(max(change, -FASTEST_SLOWING), FASTEST_RECOVERY)
        rate = before + step * pace.change
        pace.rate = min(max(rate, 0.0), 1.0)
        if pace.rate != rate:
            pace.change = 0.0
    pace.delay += (1.0 - 0.5 * (before + pace.rate)) * step * SECOND_NS
