"""How a servo pump coasts once it is told to stop, and from which flow it still can be."""

from __future__ import annotations

import math

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray
from mhsb_sim.servo.reference import AHEAD

FINE = 4
"""Looks that a coasting pump is given up to the first point of the reference ahead."""


@kernel(borrows=True)
def coasting_volumes(
    lag: float, delay: float, later: float, time: FloatArray, volumes: FloatArray
) -> None:
    """What a pump delivers up to each time [s] once told to stop, per flow that it has then [s].

    It is told at time 0, and nothing counts of what it does before that can act, at its delay [s].
    From then on t where that comes `later` [s], and τ (1 − e^(−t/τ)) with its lag τ [s] after that.
    """
    for k in range(len(time)):
        left = max(time[k] - delay, 0.0)
        late = min(left, later)
        volumes[k] = late - lag * math.expm1(-(left - late) / lag)


@kernel(borrows=True)
def coasting_limit(
    volume: FloatArray,
    coasting: FloatArray,
    capacity: float,
    rise: float,
    rise_ahead: float,
    pending: float,
    doubt: float,
    spacing: float,
) -> float:
    """Largest flow [m³/s] from which a pump can be stopped without filling its line too far.

    From Q it delivers at least Q τ (1 − e^(−t/τ)) up to t, beyond what is on its way. That is not
    to exceed what is drawn by then and what the pressure may rise by, V(t) + C Δp(t), at each point
    ahead, and `FINE` times up to the first: pressure is highest when the pump has slowed down to
    what is drawn, soon after.

    volume      float64[REFERENCE_POINTS] m³, V at the points, quadratic up to the first, which its
                first value tells: what the flow of now would draw by then
    coasting    float64[FINE + REFERENCE_POINTS − 1] s, τ (1 − e^(−t/τ)) at all these times from 0
    rise        Δp [Pa] now, rise_ahead from point `AHEAD` on, linear in between
    pending     oil [m³] that comes whatever is told now
    doubt       flow [m³/s] that may not be drawn after all
    spacing     from point to point [s]
    """
    limit = np.inf
    for k in range(1, FINE):
        share = k / FINE
        room = capacity * (rise + share / AHEAD * (rise_ahead - rise)) - pending
        drawn = share * (volume[0] + share * (volume[1] - volume[0]) - doubt * spacing)
        limit = min(limit, (drawn + room) / coasting[k])
    for k in range(1, len(volume)):
        way = min(k / AHEAD, 1.0)
        room = capacity * (rise + way * (rise_ahead - rise)) - pending
        drawn = volume[k] - doubt * spacing * k
        limit = min(limit, (drawn + room) / coasting[FINE - 1 + k])
    return limit
