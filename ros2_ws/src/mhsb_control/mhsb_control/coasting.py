"""Coasting of a servo pump after a stop command, and the largest flow for a stop in time."""

import math

import numpy as np

from mhsb_control.reference import PREVIEW_POINT
from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray

COASTING_SAMPLES = 4
"""Number of time steps in which coasting is computed between now and point 1 of the reference."""


@kernel(borrows=True)
def compute_coasting_volumes(
    lag: float, delay: float, extra_delay: float, time: FloatArray, volumes: FloatArray
) -> None:
    """Compute the oil that a coasting pump delivers up to given times, per unit of flow.

    A pump coasts after a stop command, which is sent at time 0 and acts after `delay`. Oil that is
    delivered before the command acts is not counted. From then on, the pump keeps its flow Q for
    the time `extra_delay`. After that its flow decays as a first-order lag. t is the time since the
    command acts, and t_k the part of it at constant flow:

        V/Q = t_k + τ (1 − e^(−(t − t_k)/τ))
        t   = max(time − delay, 0),    t_k = min(t, extra_delay)

    Args:
        lag: τ, time constant of the pump [s].
        delay: Time until the command acts [s].
        extra_delay: Time for which the flow stays constant after the command acts [s].
        time: Times after the command, float64[k], [s].
        volumes: Delivered volume V per flow Q at each time, float64[k], [s]. Written in place.
    """
    for k in range(len(time)):
        left = max(time[k] - delay, 0.0)
        late = min(left, extra_delay)
        volumes[k] = late - lag * math.expm1(-(left - late) / lag)


@kernel(borrows=True)
def compute_coasting_limit(
    volume: FloatArray,
    coasting: FloatArray,
    capacity: float,
    rises: tuple[float, float],
    pending: float,
    flow_uncertainty: float,
    spacing: float,
) -> float:
    """Compute the largest pump flow from which the pump can stop without overfilling its line.

    A pump that is stopped from the flow Q still delivers Q V_c(t) of oil, plus the oil `pending`.
    Up to each time t this must not exceed the oil that the line passes on or stores:

        Q V_c(t) + pending ≤ V(t) − flow_uncertainty t + C Δp(t)

    The condition is checked from the time at which a command sent now acts; nothing can be changed
    before that time. The times are the coming points of the reference, `spacing` apart, and
    COASTING_SAMPLES − 1 evenly spaced times before the first of them. The times before the first
    point matter, since the pressure peaks when the pump has slowed down to the drawn flow.

    Args:
        volume: V, oil drawn from the line up to each point, float64[points], [m³]. Element k ≥ 1
            belongs to the time k times `spacing`. Up to point 1, V is taken as quadratic in time.
            Element 0 gives its first slope: it is the volume that the present flow would draw up to
            point 1.
        coasting: V_c, delivered volume per flow, float64[COASTING_SAMPLES + points − 1], [s]. The
            first COASTING_SAMPLES times are evenly spaced from 0 to before point 1, the others are
            points 1, 2, ….
        capacity: C, capacity of the line [m³/Pa].
        rises: Allowed pressure rise Δp at present, and Δp from point PREVIEW_POINT on [Pa]. In
            between Δp is linear in time.
        pending: Oil that arrives whatever is commanded now [m³].
        flow_uncertainty: Uncertain part of the drawn flow, which is not counted [m³/s].
        spacing: Time between two points [s].

    Returns:
        Largest admissible flow Q [m³/s]. It is negative if even a stopped pump would overfill the
        line, and inf if no command can act before the last point.
    """
    rise, rise_ahead = rises
    limit = np.inf
    for k in range(1, COASTING_SAMPLES):
        if coasting[k] <= 0.0:
            continue
        share = k / COASTING_SAMPLES
        room = capacity * (rise + share / PREVIEW_POINT * (rise_ahead - rise)) - pending
        drawn = share * (volume[0] + share * (volume[1] - volume[0]) - flow_uncertainty * spacing)
        limit = min(limit, (drawn + room) / coasting[k])
    for k in range(1, len(volume)):
        if coasting[COASTING_SAMPLES - 1 + k] <= 0.0:
            continue
        way = min(k / PREVIEW_POINT, 1.0)
        room = capacity * (rise + way * (rise_ahead - rise)) - pending
        drawn = volume[k] - flow_uncertainty * spacing * k
        limit = min(limit, (drawn + room) / coasting[COASTING_SAMPLES - 1 + k])
    return limit
