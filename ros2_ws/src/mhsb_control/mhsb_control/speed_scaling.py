"""Speed scaling: the rate at which the reference passes along its path.

A plan is evaluated at its own time τ. τ̇ = s is the rate, which is 1 unless the plan is slowed:

    q = Q(τ),  q̇ = Q′ s,  q̈ = Q″ s² + Q′ ṡ

So the arm passes only postures of the plan Q(τ), and none of them faster than planned. The delay t
− τ remains until the plan has ended. Then τ runs twice as fast as the time t until the delay is 0.

Source: path-velocity decomposition, Siciliano et al., Robotics, Section 4.3.
"""

from __future__ import annotations

from dataclasses import dataclass

from mhsb_model.kernels.kernel import kernel
from mhsb_model.records import Record, Records, create_records
from mhsb_model.trajectory import SECOND_NS


@dataclass(frozen=True)
class ScalingSettings(Record):
    """Tuned numbers of the speed scaling."""

    rate_bandwidth: float = 40.0
    """Natural frequency ω of the rate's approach to the requested one [rad/s], 1 … 1000.

    Origin: chosen; 25 ms, about what a servo pump takes to change its flow.

    30 % smaller and larger, N = 5: RMS error −2.3 and −5.9 % (mhsb_arm3), −3.6 and +8.1 %
    (excavator; overshoot −3.32 and −0.30 MPa, falls +0 and +1)."""
    max_slowing: float = 1.7
    """Largest −ṡ, as a multiple of the machine's braking rate, 0.1 … 1000.

    `compute_braking_rate` gives the braking rate. So at most 1.7 times the main pump's pressure
    brakes the slowest joint at V_max. Origin: chosen; 8 1/s for the suite's own arm. The boosted
    slew of an excavator of 20 t, whose rate is 0.3 1/s, misses its path by 0.4 m with 8 1/s and by
    0.05 m with 0.5 1/s.

    30 % smaller and larger, N = 5: RMS error −3.0 and −4.0 % (mhsb_arm3; overshoot +0.19 and
    −0.04 MPa), −2.2 and +2.9 % (excavator; overshoot −3.52 and +0.68 MPa)."""
    max_recovery: float = 0.25
    """Largest ṡ, as a share of the largest −ṡ, above 0 … 1.

    Origin: chosen, so that speeding up does not use up a pressure reserve that has just returned.

    30 % smaller and larger, N = 5: RMS error −6.1 and −3.1 % (mhsb_arm3), +0.4 and +9.1 %
    (excavator; overshoot −2.03 and −1.31 MPa, falls +1 and +0)."""
    slowing_time: float = 0.04
    """Time in which the largest |s̈| reaches the largest −ṡ [s], 0.001 … 1.

    Origin: chosen; in 40 ms the pumps follow the lower need while braking.

    30 % smaller and larger, N = 5: RMS error −5.7 and −4.9 % (mhsb_arm3; overshoot −0.21 and
    +0.10 MPa), +8.0 and +12.1 % (excavator; overshoot −0.65 and −0.38 MPa, falls +0 and +1)."""


class SpeedScaling(Record):
    """State of the speed scaling."""

    rate: float
    """Rate s, 0 … 1."""
    change: float
    """Rate of change ṡ [1/s]."""
    delay: float
    """Delay t − τ [ns]."""
    rests: float
    """1 if the plan has ended, else 0."""


NEARLY_FULL, NEARLY_NONE = 1e-3, 1e-4
"""Tolerances at which the rate is set exactly: 1 − s towards 1, and s towards 0."""


def build_full_speed_scaling() -> Records[SpeedScaling]:
    """Return the state of a speed scaling that nothing has slowed.

    Returns:
        SpeedScaling[1] with rate 1 and no delay.
    """
    scaling = create_records(SpeedScaling, 1)
    scaling["rate"] = 1.0
    return scaling


@kernel
def update_rate(
    scaling: SpeedScaling,
    requested_rate: float,
    step: float,
    max_slowing: float,
    settings: ScalingSettings,
) -> None:
    """Move the rate of a plan towards the requested rate by one control period.

        s̈ = ω² (s_req − s) − 2 ω ṡ

    s is the rate, s_req the requested rate, and ω is `rate_bandwidth`. ṡ changes continuously. With
    μ = `max_slowing`, |s̈| is at most μ/`slowing_time`, ṡ is from −μ to `max_recovery` · μ, and s
    from 0 to 1. If s reaches a limit, ṡ becomes 0. If s_req is 1 and s above 1 − NEARLY_FULL, s
    becomes 1 at once. If s_req is 0 and s below NEARLY_NONE, s becomes 0 at once. The delay of the
    reference behind the plan grows by (1 − s) times the duration of the step.

    If the reference has reached the end of the plan (`scaling.rests`), the rate becomes 1 at once.
    The delay then decreases by the duration of the step, but not below 0, because time catches up
    with a reference that rests.

    Args:
        scaling: State of the speed scaling. Reads `rests`. Writes `rate` (s), `change` (ṡ) [1/s]
            and `delay` [ns] in place.
        requested_rate: Requested rate, 0 (standstill) … 1 (full speed).
        step: Control period [s].
        max_slowing: Largest decrease μ of the rate per second [1/s].
        settings: Tuned numbers.
    """
    before, goal = scaling.rate, requested_rate
    if scaling.rests > 0.0:
        scaling.rate, scaling.change = 1.0, 0.0
        scaling.delay = max(0.0, scaling.delay - step * SECOND_NS)
        return
    if goal == 1.0 and before > 1.0 - NEARLY_FULL:
        scaling.rate, scaling.change = 1.0, 0.0
    elif goal == 0.0 and before < NEARLY_NONE:
        scaling.rate = scaling.change = 0.0
    else:
        omega = settings.rate_bandwidth
        jerk = omega * (omega * (goal - before) - 2.0 * scaling.change)
        most = max_slowing / settings.slowing_time
        change = scaling.change + step * min(max(jerk, -most), most)
        scaling.change = min(max(change, -max_slowing), settings.max_recovery * max_slowing)
        rate = before + step * scaling.change
        scaling.rate = min(max(rate, 0.0), 1.0)
        if scaling.rate != rate:
            scaling.change = 0.0
    scaling.delay += (1.0 - 0.5 * (before + scaling.rate)) * step * SECOND_NS
