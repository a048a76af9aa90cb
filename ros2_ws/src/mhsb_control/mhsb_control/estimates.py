"""Estimates of a servo: values, uncertainty, and whether they are known."""

from collections.abc import Sequence

import numpy as np

from mhsb_control.line_estimate import LineEstimates
from mhsb_control.load_estimate import LoadEstimate, LoadSettings
from mhsb_control.pump_estimate import DriveEstimates
from mhsb_control.servo_pumps import PumpSettings
from mhsb_control.spools.lag_estimate import (
    LAG_EXCESSES,
    LagEstimates,
    describe_lag_uncertainty,
)
from mhsb_control.valve_estimate import ValveEstimates
from mhsb_model.arm_reports import Estimate

KNOWN_DEVIATION_RATIO = 0.5
"""Standard deviation below which a value counts as known, as a share of the initial one."""


def collect_estimates(
    names: Sequence[str],
    load: LoadEstimate,
    valves: ValveEstimates,
    lags: LagEstimates,
    lines: LineEstimates,
    drives: DriveEstimates,
    load_settings: LoadSettings,
    pump_settings: PumpSettings,
) -> list[Estimate]:
    """Collect the estimates of all estimators with their standard deviations.

    Bulk modulus and overlap are functions of the estimated parameters; their variances are
    propagated to first order. The delay has no standard deviation; the longest plausible delay
    minus the estimated delay takes its place. For the valves' lag, the largest difference to
    a plausible lag takes its place.

    Args:
        names: Names of the actuators, in the order of the estimators' arrays.
        load: Estimates of payload and friction.
        valves: Estimates of the valves.
        lags: Estimate of the valves' lag.
        lines: Estimates of oil compressibility and leakage.
        drives: Estimates of pump lag and command delay.
        load_settings: Tuned numbers of `load`, with initial standard deviations.
        pump_settings: Tuned numbers of `lines` and `drives`, with initial standard deviations.

    Returns:
        Estimates with the units of `Estimate`. First are payload, bulk modulus, pump lag, delay
        and valve lag, with an empty actuator name. Friction, valve gain, overlap and leakage of
        each actuator follow. An estimate counts as known if its standard deviation is below
        KNOWN_DEVIATION_RATIO times the initial one.
    """
    return [
        *_build_shared_estimates(load, lines, drives, load_settings, pump_settings),
        _build_estimate(
            "valve_lag",
            "",
            lags.record["lag"][0],
            describe_lag_uncertainty(lags),
            max(LAG_EXCESSES),
        ),
        *(
            estimate
            for j, name in enumerate(names)
            for estimate in (
                _build_estimate(
                    "friction",
                    name,
                    load.estimate[1 + j],
                    np.sqrt(load.covariance[1 + j, 1 + j]),
                    load_settings.friction_deviation,
                ),
                *_build_valve_estimates(name, j, valves),
                _build_estimate(
                    "leakage",
                    name,
                    lines.estimate[1 + j],
                    np.sqrt(lines.covariance[1 + j, 1 + j]),
                    pump_settings.lines.leakage_deviation,
                ),
            )
        ),
    ]


def _build_shared_estimates(
    load: LoadEstimate,
    lines: LineEstimates,
    drives: DriveEstimates,
    load_settings: LoadSettings,
    pump_settings: PumpSettings,
) -> list[Estimate]:
    """Build the estimates of the whole arm.

    Args:
        load: Estimates of payload and friction.
        lines: Estimates of oil compressibility and leakage.
        drives: Estimates of pump lag and command delay.
        load_settings: Tuned numbers of `load`, with initial standard deviations.
        pump_settings: Tuned numbers of `lines` and `drives`, with initial standard deviations.

    Returns:
        Estimates of payload, bulk modulus, pump lag and delay, with an empty actuator name. The
        bulk modulus is relative to that of the machine file. The deviation of the delay is its
        distance from the longest plausible delay.
    """
    lag, deviation, delay, latest, step = (
        drives.record[name][0]
        for name in ("lag", "deviation", "delay", "max_plausible_delay", "step")
    )
    squeeze = lines.estimate[0]
    first_lag = pump_settings.drives.initial_deviation * lag
    first_delay = pump_settings.drives.initial_delay_range * step
    return [
        _build_estimate(
            "payload",
            "",
            load.estimate[0],
            np.sqrt(load.covariance[0, 0]),
            load_settings.payload_deviation * float(load.file_payload[0]),
        ),
        _build_estimate(
            "bulk_modulus",
            "",
            1.0 / squeeze,
            np.sqrt(lines.covariance[0, 0]) / squeeze**2,
            pump_settings.lines.compressibility_deviation,
        ),
        _build_estimate("pump_lag", "", lag, deviation * lag, first_lag),
        _build_estimate("delay", "", delay * step, (latest - delay) * step, first_delay),
    ]


def _build_valve_estimates(name: str, j: int, valves: ValveEstimates) -> tuple[Estimate, Estimate]:
    """Build the estimates of gain and overlap of one valve.

        o = b/(g + b)

    o is the overlap in one direction. The estimator gives the gain g, and b for each direction. The
    variances are propagated to first order.

    Args:
        name: Name of the actuator.
        j: Index of the actuator.
        valves: Estimates of the valves.

    Returns:
        Estimates of the valve gain and of the overlap. The overlap is the mean of both directions.
    """
    gain, laps = valves.estimate[j, 0], valves.estimate[j, 1:3]
    own = valves.covariance[j, :3, j, :3]
    # the mean of both overlaps o = b/(g + b), its variance to first order
    slopes = np.array([-np.mean(laps / (gain + laps) ** 2), *(0.5 * gain / (gain + laps) ** 2)])
    lap, lap_variance = float(np.mean(laps / (gain + laps))), slopes @ own @ slopes
    of_gain, of_overlap = (
        float(valves.settings[key][0]) for key in ("gain_deviation", "overlap_deviation")
    )
    return (
        _build_estimate("valve_gain", name, gain, np.sqrt(own[0, 0]), of_gain),
        _build_estimate("overlap", name, lap, np.sqrt(lap_variance), of_overlap),
    )


def _build_estimate(
    quantity: str, actuator: str, value: float, deviation: float, first: float
) -> Estimate:
    """Build an estimate, and decide whether its value counts as known.

    Args:
        quantity: Name of the quantity.
        actuator: Name of the actuator; empty for the whole arm.
        value: Estimated value, in the unit of `Estimate`.
        deviation: Standard deviation of the value, in the same unit.
        first: Standard deviation before anything was measured, in the same unit.

    Returns:
        The estimate. `known` is True if `deviation` is below KNOWN_DEVIATION_RATIO times `first`.
    """
    known = bool(deviation < KNOWN_DEVIATION_RATIO * first)
    return Estimate(quantity, actuator, float(value), float(deviation), known)
