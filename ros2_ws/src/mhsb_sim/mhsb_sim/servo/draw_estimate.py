"""By how much less a boosted line draws than its piston is told to: an observer of the line's oil.

    drawn = Q − q_leak − c C ṗ,        τ ḋ = (drawn − told) − d

with Q the pumps' measured flow, C what the line takes by the machine file, c as learnt
(`servo/line_estimate`), and told = A_dir |u|, as late as it acts. A valve whose overlap is not
known yet passes less than it is opened for, and lines are stiff: what is delivered in vain raises
their pressure by 1 MPa in a few milliseconds. A line that lacks pressure is not judged: it gives
what there is. Source: W.-H. Chen, J. Yang, L. Guo, S. Li, Disturbance-observer-based control and
related methods, IEEE Trans. Industrial Electronics 63, 2016.
"""

from __future__ import annotations

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_sim.records import Record, Records

OBSERVED = 0.02
"""τ [s]: longer than commands are late, shorter than a piston takes to set out."""

NEAR = 2e5
"""Pressure below its target [Pa] from which on a line is judged the less the lower it is."""

DRAW = np.dtype(
    [
        ("pressure", "f8"),  # Pa, a step ago
        ("told", "f8"),  # m³/s, as late as it acts
        ("more", "f8"),  # m³/s, d
    ]
)


def draws_of(count: int) -> Records:
    """Of n lines and the rail, which is the last one: DRAW[n + 1]."""
    return np.zeros(count + 1, DRAW)


@kernel
def observe(
    draw: Record,
    pressure: float,
    supplied: float,
    told: float,
    capacity: float,
    lag: float,
    step: float,
    alone: bool,
) -> None:
    """Take a step [s] of a line.

    pressure: measured [Pa]; supplied: by pumps, less leakage [m³/s]; told: A_dir |u| [m³/s], which
    acts after `lag` [s]; capacity: c C [m³/Pa]; alone: whether pumps alone feed it.
    """
    drawn = supplied - capacity * (pressure - draw.pressure) / step
    draw.more += step / OBSERVED * (drawn - draw.told - draw.more)
    if not alone:
        draw.more = 0.0
    draw.pressure = pressure
    draw.told += step / (lag + step) * (told - draw.told)


@kernel
def drawn_less(draw: Record, target: float) -> float:
    """Flow [m³/s] that the line takes less than told; target: of its pressure [Pa]."""
    share = min(max((draw.pressure - target + NEAR) / NEAR, 0.0), 1.0)
    return share * max(-draw.more, 0.0)
