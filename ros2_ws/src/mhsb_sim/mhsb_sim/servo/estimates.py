"""What a servo has learnt of its machine: values, uncertainty, and whether they are known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mhsb_model.arm_reports import Estimate
from mhsb_sim.servo import line_estimate, pump_estimate, valve_estimate
from mhsb_sim.servo.line_estimate import Lines
from mhsb_sim.servo.load_estimate import FRICTION_DEVIATION, SHARE_OF_PAYLOAD, Load
from mhsb_sim.servo.pump_estimate import Drives
from mhsb_sim.servo.valve_estimate import Valves

KNOWN_BELOW = 0.5
"""Standard deviation, as a share of what it was at first, from which on a value counts as known."""


def estimates_of(
    names: Sequence[str], load: Load, valves: Valves, lines: Lines, drives: Drives
) -> list[Estimate]:
    """All that is learnt of the actuators of these names."""
    spread, oil = np.sqrt(np.diag(load.covariance)), np.sqrt(np.diag(lines.covariance))
    first = SHARE_OF_PAYLOAD * float(load.file[0])
    drive, squeeze = drives.record[0], lines.believed[0]
    late = (drive["latest"] - drive["delay"]) * drive["step"]
    of_bulk = oil[0] / squeeze**2
    found = [
        _estimate("payload", "", load.believed[0], spread[0], first),
        _estimate("bulk_modulus", "", 1.0 / squeeze, of_bulk, line_estimate.SQUEEZE_DEVIATION),
        _estimate(
            "pump_lag", "", drive["lag"], drive["deviation"] * drive["lag"],
            pump_estimate.DEVIATION * drive["lag"],
        ),
        _estimate(
            "delay", "", drive["delay"] * drive["step"], late, pump_estimate.LATEST * drive["step"]
        ),
    ]  # fmt: skip
    for j, name in enumerate(names):
        gain, overlap, _ = valves.estimate[j]
        own = valves.covariance[j]
        lap = overlap / gain
        # of o = b/a and g = a (1 − o) = a − b, to first order
        lap_variance = (own[1, 1] - 2.0 * lap * own[0, 1] + lap**2 * own[0, 0]) / gain**2
        gain_variance = own[0, 0] - 2.0 * own[0, 1] + own[1, 1]
        of_gain, of_overlap, _ = valve_estimate.DEVIATION
        found += [
            _estimate("friction", name, load.believed[1 + j], spread[1 + j], FRICTION_DEVIATION),
            _estimate("valve_gain", name, gain - overlap, np.sqrt(gain_variance), of_gain),
            _estimate("overlap", name, lap, np.sqrt(lap_variance), of_overlap),
            _estimate(
                "leakage", name, lines.believed[1 + j], oil[1 + j], line_estimate.LEAKAGE_DEVIATION
            ),
        ]
    return found


def _estimate(
    quantity: str, actuator: str, value: float, deviation: float, first: float
) -> Estimate:
    known = bool(deviation < KNOWN_BELOW * first)
    return Estimate(quantity, actuator, float(value), float(deviation), known)
