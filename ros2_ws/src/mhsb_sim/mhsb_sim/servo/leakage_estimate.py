"""How much the valves of boosted lines leak, learnt from what their pumps deliver.

Over a window in which a pump feeds one line alone, above the manifold's pressure,

    ∫ Q dt − A_dir |ΔL| − C Δp = λ ∫ q_leak(p) dt

with Q the pump's measured flow, C the line's capacity, A_dir the area of its cylinder's inlet, and
q_leak the leakage of the valve by the machine file. A Kalman filter of λ, which wanders slowly,
takes up window after window; until there has been one, λ keeps its standard deviation. Source: the
line's balance of oil (H. E. Merritt, Hydraulic Control Systems).
"""

from __future__ import annotations

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_sim.records import Record, Records

WINDOW = 40
"""Steps of a window."""

DEVIATION, WANDER = 0.3, 5e-3
"""Standard deviation of λ before anything is learnt, and by which it wanders in a window."""

FLOW = 2e-7
"""Standard deviation of a window's mean flow [m³/s]: chambers that are compressed, sensors."""

LARGEST_RATE = 2e7
"""Fastest change of pressure [Pa/s] over a window that is learnt from: C is not known well."""

LEAST, MOST = 0.2, 3.0
"""λ that is taken for an estimate."""

LEAK = np.dtype(
    [
        ("share", "f8"),  # λ
        ("variance", "f8"),
        ("steps", "i8"),  # of the window so far
        ("delivered", "f8"),  # m³, by the pump
        ("leaked", "f8"),  # m³, by the file's leakage
        ("pressure", "f8"),  # Pa, at its start
        ("length", "f8"),  # m, at its start
    ]
)


def leaks_of(count: int) -> Records:
    """LEAK[n] as the machine file has them, not known well."""
    leaks = np.zeros(count, LEAK)
    leaks["share"] = 1.0
    leaks["variance"] = DEVIATION**2
    return leaks


@kernel
def balance(
    leak: Record,
    alone: bool,
    flow: float,
    leakage: float,
    pressure: float,
    length: float,
    cylinder: Record,
    capacity: float,
    step: float,
) -> None:
    """Take a step into the window of a line, and learn from the window when it is full.

    alone: whether one pump feeds nothing but this line; flow: Q, leakage: q_leak(p) [m³/s];
    pressure [Pa], length [m] of its cylinder; capacity: C [m³/Pa].
    """
    if not alone:
        leak.steps = 0
        return
    if leak.steps == 0:
        leak.delivered = leak.leaked = 0.0
        leak.pressure, leak.length = pressure, length
        leak.steps = 1
        return
    leak.delivered += flow * step
    leak.leaked += leakage * step
    leak.steps += 1
    if leak.steps <= WINDOW:
        return
    span = WINDOW * step
    leak.steps = 0
    rise, way = pressure - leak.pressure, length - leak.length
    if abs(rise) > LARGEST_RATE * span:
        return
    taken = cylinder.cap_area * way if way > 0.0 else -cylinder.rod_area * way
    lost = leak.delivered - taken - capacity * rise
    leak.variance += WANDER * WANDER
    spread = leak.leaked * leak.leaked * leak.variance + (FLOW * span) ** 2
    gain = leak.variance * leak.leaked / spread
    leak.share += gain * (lost - leak.share * leak.leaked)
    leak.share = min(max(leak.share, LEAST), MOST)
    leak.variance -= gain * leak.leaked * leak.variance
