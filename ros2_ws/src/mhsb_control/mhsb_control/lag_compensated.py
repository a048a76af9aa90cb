"""Lag-compensated control: for machines with proportional valves and without pressure sensors.

Such machines have dead bands, slow sensors, and delays and lags of a few tenths of a second. The
plan is known ahead, so each command is sent earlier by the time of delay and lag:

    u(t) = g(v),   v = v_ref(t + h) + k_p e
    e    = L_ref(t + h) − mean of L(τ) + ∫ f(u(s)) ds   over s from τ − h to t

g is the inverse curve of the valve: it gives the command u for a piston speed v. f = g⁻¹ gives the
speed that a command causes. h is delay plus lag. g and h are learnt for each actuator
(`actuator_response`). L is the length of the cylinder, and L_ref and v_ref are length and speed of
the reference. e is the position error, and k_p is a gain. The integral in e predicts the stroke
that commands cause after τ, so that an error is not corrected twice (Smith predictor).

The mean runs over the τ of one period of the joint's oscillation on its oil. It hides this
oscillation from the delayed feedback, which would excite it. There is no integral part: the learnt
curve removes lasting errors. An integral would wind up while a dead band is learnt.

At rest the position is corrected by single commands. A new correction begins only when the previous
correction has acted.

The demanded speed is limited to a multiple of the speed at the curve's fastest known knot, at first
to a share of the speed limit. Servo pumps deliver the flow A_dir |v| that the pistons take at the
demanded speeds. A_dir is the piston area into which oil flows.

Source: O. J. M. Smith, Closer control of loops with dead time (1957); Z. Artstein, Linear systems
with delayed controls (1982); M. Jelali, A. Kroll, Hydraulic Servo-systems (dead band compensation).
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import ClassVar

import numpy as np
from pydantic import Field

from mhsb_control.actuator_response import (
    SPEED_KNOTS,
    DelayEstimate,
    InverseCurve,
    ResponseSettings,
)
from mhsb_control.cascade import joins_rail
from mhsb_control.controller import REFERENCE_POINTS, ServoSignals
from mhsb_control.estimates_file import ActuatorResponse
from mhsb_control.natural_frequency import find_joint_frequency_ranges
from mhsb_control.reference import PREVIEW_POINT
from mhsb_model.arm_reports import Estimate
from mhsb_model.hydraulics import (
    compute_extension_speed,
    compute_retraction_speed,
    compute_slip_flow,
    inlet_area,
)
from mhsb_model.linkages.linkage import evaluate_linkage_at_angles
from mhsb_model.machine import Machine
from mhsb_model.schema import (
    DEFAULT_EXPECTED_DELAY,
    ExpectedDelay,
    Gain,
    Imperfections,
    NonNegative,
    Section,
)
from mhsb_model.trajectory import quintic_hermite
from mhsb_model.types import FloatArray

LookAhead = Callable[[float], tuple[float, float]]
"""Function that returns length [m] and speed [m/s] of a piston's reference a time [s] ahead."""


class LagCompensatedGains(Section):
    """Gains of the `lag_compensated` controller."""

    rate: float = Field(default=100.0, ge=5.0, le=1000.0, description="of control and sensors [Hz]")
    expected_delay: ExpectedDelay = DEFAULT_EXPECTED_DELAY
    position_gain: Gain = Field(
        default=0.5,
        description="piston speed per position error, in 1/(delay + control period + half a "
        "period of the joint on its oil) [-]",
    )
    rest_error: NonNegative = Field(
        le=1.0,
        default=0.005,
        description="error left at rest, as a time at V_max [s]",
    )
    pump_surplus: NonNegative = Field(
        le=1.0, default=0.1, description="flow of servo pumps beyond the pistons' [-]"
    )


@dataclass(frozen=True)
class LagCompensationSettings:
    """Tuned numbers of the lag-compensated controller.

    The effect of 30 % smaller and larger numbers has not been measured.
    """

    window: float = 0.2
    """Least time over which speeds are measured [s], 0.05 … 1. A joint that oscillates on its oil
    needs at least one period. For as long before it, the command must not change its direction.

    Origin: chosen; two samples at 10 Hz, and lags up to 0.2 s."""
    standing_delays: float = 1.5
    """Time for which a command must act without motion before it counts as inside the dead band, in
    delays, 0 … 1.5.

    Origin: chosen; after 1.5 delays, a lag that makes up most of the delay has reached 0.8 of its
    end."""
    spread_share: float = 0.4
    """Standard deviation of a command, as a share of its change in the window and as long before,
    0.1 … 1.

    Origin: chosen; the lag, and so the command that acts during a ramp, is not known exactly."""
    max_spread_ratio: float = 1.1
    """Largest standard deviation of the lengths in a window from which a curve is learnt, relative
    to uniform motion with the same stroke, 1 … 1.21.

    Origin: the command causes a nearly uniform motion, with a ratio near 1. For an oscillation
    about a fixed length the ratio is at least 1.216 in any window of one to six periods (computed
    on a grid of windows and phases)."""
    first_speed_ratio: float = 0.3
    """Speed that may be demanded before anything is known, as a share of the speed limit, 0.05 … 1.

    It is also the largest speed by which the position is corrected.

    Origin: chosen; slow enough to see what the arm does."""
    known_speed_factor: float = 2.0
    """Largest demanded speed, as a multiple of the speed at the fastest known knot, 1 … 10.

    Origin: the spacing of the knots."""
    max_creep_ratio: float = 16.0
    """Largest ratio of real to predicted motion in corrections at rest, 1 … 100.

    Origin: the curve is steep beyond a dead band; an error of 0.02 in the command changes the speed
    by a factor of 10."""
    end_share: float = 0.02
    """Share of the stroke at each end in which motion towards this end teaches nothing, 0 … 0.2.

    Origin: chosen; the stops of real arms lie a little inside the limits of the machine file."""
    response: ResponseSettings = field(default_factory=ResponseSettings)
    """Settings of the estimates of curves and delay."""


class LagCompensatedAxis:
    """Control law of one actuator, with its estimates.

    Attributes:
        curves: Inverse curves for extension and retraction.
        delay: Estimated delay between command and motion.
        speed: Demanded piston speed v of the last period [m/s].
        learns: Whether the estimates are updated.
    """

    def __init__(
        self,
        full_speeds: tuple[float, float],
        max_speed: float,
        period: float,
        gains: LagCompensatedGains,
        settings: LagCompensationSettings = LagCompensationSettings(),
        ends: tuple[float, float] = (-math.inf, math.inf),
        frequency: float = math.inf,
        declared: tuple[FloatArray | None, FloatArray | None] = (None, None),
    ) -> None:
        """Build the control law of one actuator before its first control period.

        Args:
            full_speeds: Assumed piston speeds at the full command, extending and retracting [m/s],
                both > 0.
            max_speed: Speed limit of the piston [m/s].
            period: Control period [s].
            gains: Gains of the controller.
            settings: Tuned numbers.
            ends: Two cylinder lengths [m]: retracting motion teaches nothing below the first,
                extending motion nothing above the second.
            frequency: Lowest natural frequency of the joint on the oil of its cylinder [rad/s].
            declared: Commands at the knots of the two curves, from the machine file's valve table,
                float64[k]; None without a table.
        """
        self._ends = ends
        self._gains, self._settings, self._max_speed = gains, settings, max_speed
        self._period = period
        self.delay = DelayEstimate(gains.expected_delay, max_speed, settings.response)
        self.speed, self.learns = 0.0, True
        self._rested, self._last_correction, self._creep_ratio = 0.0, 0.0, 1.0
        self._brief = max(round(settings.window / self._period), 1)
        oscillation = max(round(2.0 * math.pi / frequency / self._period), 1)
        self._averaged = self._period * np.arange(oscillation - 1, -1, -1)
        self._window = max(oscillation, self._brief)
        ratio = self._brief / self._window  # by equal strokes
        self._slowest = ratio * settings.response.speed_deviation * max_speed
        driven = ratio * settings.response.min_driven_ratio
        response = replace(settings.response, min_driven_ratio=driven)
        self.curves = tuple(
            InverseCurve(v, max_speed, response, commands)
            for v, commands in zip(full_speeds, declared, strict=True)
        )
        longest = settings.response.max_delay
        settling = max(settings.standing_delays * longest, settings.window)
        kept = max(2.0 * longest, longest + settling)
        self._commands = np.zeros(math.ceil(kept / self._period) + self._window + 2)
        self._lengths = np.full(self._window + 1, np.nan)
        self._ages = self._period * np.arange(len(self._commands), -1, -1)

    def update(self, length: float, look_ahead: LookAhead) -> float:
        """Learn from the measured length, and compute the valve command of one control period.

        Nothing is learnt while `learns` is False, or before a whole window of lengths was measured.

        Args:
            length: Measured length of the cylinder [m].
            look_ahead: Function that returns the reference length [m] and speed [m/s] at a time
                from now [s].

        Returns:
            Valve command, −1 … 1.
        """
        self._lengths[:-1] = self._lengths[1:]
        self._lengths[-1] = length
        if self.learns and not math.isnan(self._lengths[0]):
            self._learn()
        command = self._command(look_ahead)
        self._commands[:-1] = self._commands[1:]
        self._commands[-1] = command
        return command

    def _command(self, look_ahead: LookAhead) -> float:
        """Compute the valve command of this control period.

        The demanded speed is the reference's speed one delay from now, plus a correction in
        proportion to the error. The error is the reference length minus a mean predicted length. A
        predicted length is a measured length plus the stroke that commands cause after the
        measurement. The mean runs over one period of the joint's oscillation on its oil. Once the
        reference has rested for one delay, the predicted strokes are multiplied by the ratio of
        real to predicted motion. The correction is limited by `first_speed_ratio`. The demanded
        speed is limited to `known_speed_factor` times the fastest known speed, but to no less than
        `first_speed_ratio` of the speed limit. While the reference moves, the command passes
        linearly through the dead band at speeds below the slowest one that a window of lengths
        resolves. At rest, corrections use at least the command for this speed.

        While the reference rests, `_tolerates_error` says when a correction begins and ends.

        Updates `speed`, the time at rest, and the state of corrections at rest.

        Args:
            look_ahead: Function of a time from now [s]. It returns the reference's length [m] and
                piston speed [m/s] at that time.

        Returns:
            Valve command, −1 … 1; positive extends.
        """
        s, g = self._settings, self._gains
        delay = self.delay.delay
        strokes = self._predict_strokes()
        reference, planned = look_ahead(delay)
        lengths = self._lengths[-len(self._averaged) :]
        measured = ~np.isnan(lengths)
        caused = strokes[-1] - np.interp(-delay - self._averaged[measured], -self._ages, strokes)
        length, coming_stroke = float(lengths[measured].mean()), float(caused.mean())
        rests = planned == 0.0
        if rests:
            self._rested += self._period
        else:
            self._rested = self._last_correction = 0.0
        if self._rested > delay:
            coming_stroke *= self._creep_ratio
        error = reference - length - coming_stroke
        if rests and self._tolerates_error(error):
            self.speed = 0.0
            return 0.0
        gain = g.position_gain / (delay + self._period + 0.5 * float(self._averaged[0]))
        most = s.first_speed_ratio * self._max_speed
        demanded = planned + min(max(gain * error, -most), most)
        curve = self.curves[int(demanded < 0.0)]
        known = s.known_speed_factor * curve.known_speed
        allowed = max(most, known)
        self.speed = min(max(demanded, -allowed), allowed)
        command = curve.command_at(max(abs(self.speed), self._slowest))
        if not rests:
            command *= min(abs(self.speed) / self._slowest, 1.0)
        return math.copysign(min(command, 1.0), self.speed)

    def _tolerates_error(self, error: float) -> bool:
        """Return whether the position error of a resting piston is left uncorrected.

        A correction begins when the error exceeds `rest_error` times the piston's speed limit. It
        ends when the error changes its sign. If the valve's curve is known, a correction begins
        only after the command has been 0 for two delays plus the time over which lengths are
        averaged.

        When a correction begins, its error is stored, and the ratio of real to predicted motion at
        rest is updated. If the error has changed its sign since the last correction began, that
        correction went too far, and the ratio is doubled. Otherwise the ratio is multiplied by 0.8.
        The ratio stays within 1 … `max_creep_ratio`. The first correction after a motion does not
        change the ratio, nor does a correction within one delay after the motion.

        Args:
            error: Reference length minus predicted length [m].

        Returns:
            True if the command is to be 0, False while the error is corrected.
        """
        if self.speed != 0.0:
            return error * self.speed <= 0.0
        waiting = max(math.ceil(2.0 * self.delay.delay / self._period), 1) + len(self._averaged) - 1
        small = abs(error) < self._gains.rest_error * self._max_speed
        is_known = self.curves[int(error < 0.0)].known_speed > 0.0
        if small or (is_known and self._commands[-waiting:].any()):
            return True
        s, last = self._settings, self._last_correction
        if last != 0.0 and self._rested > self.delay.delay:
            grown = 2.0 if error * last < 0.0 else 0.8
            self._creep_ratio = min(max(grown * self._creep_ratio, 1.0), s.max_creep_ratio)
        self._last_correction = error
        return False

    def _predict_strokes(self) -> FloatArray:
        """Return the running sum of the strokes that past commands cause, float64[k + 1], [m].

        Entry i is the stroke caused by all commands older than `_ages[i]`. k is the number of kept
        commands. A stroke is positive in extension.
        """
        extending, retracting = self.curves
        commands = self._commands
        speeds = extending.speeds_at(np.maximum(commands, 0.0))
        speeds = speeds - retracting.speeds_at(np.maximum(-commands, 0.0))
        return np.concatenate([[0.0], np.cumsum(speeds) * self._period])

    def _learn(self) -> None:
        """Update curves and delay from the mean speed of the piston in the last window.

        Each call also makes both curves a little less certain (`forget`).

        The delay is learnt only once each curve has a known knot. A curve is learnt only if all
        commands that caused the motion had one direction. The piston must have moved in this
        direction, and nearly uniformly (`max_spread_ratio`); this excludes oscillation on the oil.
        Near an end of the stroke no curve is learnt from commands towards that end. If the piston
        stands, its dead band may be raised (`_learn_dead_band`).

        A window that is longer than `window` resolves lower speeds. Once the valve has driven the
        piston, a standstill in such a window is learnt as any other speed. All commands that acted
        must lie between the dead band and `max_dead_band`. A dead band is then no longer raised,
        and a measured command lowers the commands for lower speeds.
        """
        s = self._settings
        time = self._window * self._period
        speed = float(self._lengths[-1] - self._lengths[0]) / time
        strokes, candidates = self._predict_strokes(), self.delay.candidates
        ends = np.interp(-candidates, -self._ages, strokes)
        starts = np.interp(-candidates - time, -self._ages, strokes)
        if all(curve.known_speed > 0.0 for curve in self.curves):
            self.delay.learn((ends - starts) / time, speed, self._period)
        for curve in self.curves:
            curve.forget(self._period)
        acted = self._commands[: len(self._commands) - math.floor(self.delay.delay / self._period)]
        newest = float(acted[-1])
        shortest, longest = self._ends  # a stop would be learnt as a dead band
        if (newest > 0.0 and self._lengths[-1] > longest) or (
            newest < 0.0 and self._lengths[-1] < shortest
        ):
            return
        curve = self.curves[int(newest < 0.0)]
        resolves_slow = curve.has_driven and self._window > self._brief
        if not resolves_slow:
            self._learn_dead_band(acted)
        steady = acted[-self._window - self._brief :]
        low, high = float(steady.min()), float(steady.max())
        forwards = math.copysign(speed, speed * newest)
        uniform = abs(speed) * time * math.sqrt((self._window + 2) / (12.0 * self._window))
        is_beyond = resolves_slow and min(abs(low), abs(high)) > curve.commands[0]
        least = self._slowest if is_beyond else s.response.speed_deviation * self._max_speed
        stands = is_beyond and forwards < least and abs(newest) < s.response.max_dead_band
        is_driven = forwards > least and self._lengths.std() < s.max_spread_ratio * uniform
        if low * high > 0.0 and (stands or is_driven):
            command = float(np.abs(steady[-self._window :]).mean())
            spread = s.spread_share * (high - low)
            curve.learn(max(forwards, 0.0), command, 1.0 / self._window, spread, resolves_slow)

    def _learn_dead_band(self, acted: FloatArray) -> None:
        """Raise the dead band of the newest command's direction if the piston stands.

        The piston stands if its mean speed over a window is below the share `speed_deviation`
        of its speed limit. The window is short until the command for one speed, a knot of the valve
        curve, is known. After that, it covers at least one period of the joint's oscillation on its
        oil. All commands in the window and in the settling time before it must have one direction.
        The smallest of these commands is a lower bound of the dead band (`raise_dead_band`).
        Otherwise nothing changes.

        Args:
            acted: Commands that are older than the delay, float64[k], in time order. There must be
                lengths for a whole window.
        """
        s = self._settings
        curve = self.curves[int(acted[-1] < 0.0)]
        window = self._window if curve.known_speed > 0.0 else self._brief
        settling = max(s.standing_delays * self.delay.delay, s.window)
        since = acted[-window - math.ceil(settling / self._period) :]
        moved = abs(self._lengths[-1] - self._lengths[-1 - window]) / (window * self._period)
        if moved < s.response.speed_deviation * self._max_speed and since.min() * since.max() > 0.0:
            curve.raise_dead_band(float(np.abs(since).min()), 1.0 / self._brief)


def compute_declared_commands(
    valves: Imperfections, max_speed: float, full_speeds: tuple[float, float]
) -> tuple[FloatArray | None, FloatArray | None]:
    """Compute the commands at the knots of both inverse curves from the machine file's valve table.

        u = o + (1 − o) [T⁻¹(v/V)]^(1/n)

    v is the speed at a knot, SPEED_KNOTS times `max_speed`. o is the overlap, T the table, n the
    exponent of the opening, and V the speed at the full command. A speed beyond V has the
    command 1.

    Args:
        valves: Section `imperfections` of the machine file.
        max_speed: Speed limit of the actuator, which scales the knots [m/s].
        full_speeds: Assumed piston speeds at the full command, extending and retracting [m/s].

    Returns:
        Commands for extension and retraction, float64[k] each; None without a table.
    """
    found: list[FloatArray | None] = []
    for curve, overlap, fastest in zip(valves.curves, valves.overlaps, full_speeds, strict=True):
        if curve is None:
            found.append(None)
            continue
        strokes, openings = np.array(curve).T
        stroke = np.interp(SPEED_KNOTS * max_speed / fastest, openings, strokes)
        found.append(overlap + (1.0 - overlap) * stroke ** (1.0 / valves.valve_exponent))
    return found[0], found[1]


class LagCompensatedController:
    """Controller that sends commands ahead by the delay of the machine, without pressure sensors.

    Attributes:
        axes: Control law of each actuator.
        settings: Tuned numbers of every new controller of this class.
    """

    gains_section: type[Section] = LagCompensatedGains
    usual_error = 20e-3
    reads_pressures = False
    supervision_limits: ClassVar[dict[str, tuple[float, float]]] = {
        "following_error": (0.15, 0.5),
        "held": (5.0, 15.0),
    }
    """Warning and stop limits of supervision [rad or s], wide enough for a servo that learns."""
    preview = 0.3
    settings: ClassVar[LagCompensationSettings] = LagCompensationSettings()

    def __init__(self, machine: Machine, signals: ServoSignals, gains: LagCompensatedGains) -> None:
        """Build the control law of each actuator.

        Each law starts with an inverse curve from the machine file. The speed at the full command
        is that of an unloaded piston at the main pump's pressure. With pressure compensators, it is
        at most that of the compensated flow. If the file declares a valve table, the curve has the
        dead band and the bend of this table (`compute_declared_commands`).

        Args:
            machine: The machine as declared in its file (the real one may differ).
            signals: Arrays that the controller reads and writes in each step.
            gains: Gains of this controller, from its section of the machine file.
        """
        arrays, step = machine.arrays, machine.config.simulation.step
        self._signals, self._arrays, self._gains = signals, arrays, gains
        self._names = machine.actuator_names
        self._steps = max(round(1.0 / (gains.rate * step)), 1)
        self._until_next = 0
        self._spacing = self.preview / PREVIEW_POINT
        supply, tank = arrays.supply_pressure, arrays.tank_pressure
        frequencies, _ = find_joint_frequency_ranges(machine)
        largest_drop = machine.config.hydraulics.valve.largest_drop
        self.axes = []
        for j in range(machine.joint_count):
            valve = arrays.valve_coefficient[j], arrays.cap_area[j], arrays.rod_area[j]
            compensated = math.sqrt(largest_drop) * valve[0] / valve[1]
            full_speeds = (
                min(compute_extension_speed(*valve, supply, tank, 0.0), compensated),
                min(compute_retraction_speed(*valve, supply, tank, 0.0), compensated),
            )
            fastest, period = float(arrays.max_piston_speed[j]), self._steps * step
            declared = compute_declared_commands(machine.config.imperfections, fastest, full_speeds)
            shortest, longest = (
                float(signals.circuit.cylinders[end][j]) for end in ("min_length", "max_length")
            )
            margin = self.settings.end_share * (longest - shortest)
            ends = shortest + margin, longest - margin
            frequency = float(frequencies[j])
            self.axes.append(
                LagCompensatedAxis(
                    full_speeds, fastest, period, gains, self.settings, ends, frequency, declared
                )
            )

    def update(self) -> None:
        """Write the commands of valves and pumps when a period of the controller begins.

        The servo calls this in each of its steps. In all other steps the last commands are kept.
        """
        if self._until_next == 0:
            self._until_next = self._steps
            self._command_valves()
            self._command_pumps()
        self._until_next -= 1

    def get_learnt(self) -> dict[str, ActuatorResponse]:
        """Return the learnt response of each actuator by its name."""
        return {
            name: ActuatorResponse(
                delay=axis.delay.delay,
                delay_known=axis.delay.is_known,
                extending=axis.curves[0].learnt,
                retracting=axis.curves[1].learnt,
            )
            for name, axis in zip(self._names, self.axes, strict=True)
        }

    def restore(self, learnt: Mapping[str, ActuatorResponse]) -> None:
        """Replace curves and delays with the values of an estimates file.

        A delay that the file marks as unknown is ignored. A delay longer than `max_delay` is
        replaced by `max_delay`.

        Args:
            learnt: Response of each actuator by its name.
        """
        longest = self.settings.response.max_delay
        for name, axis in zip(self._names, self.axes, strict=True):
            found = learnt[name]
            axis.curves[0].restore(found.extending)
            axis.curves[1].restore(found.retracting)
            if found.delay_known:
                axis.delay.delay, axis.delay.is_known = min(found.delay, longest), True

    @property
    def estimates(self) -> list[Estimate]:
        """Dead band (named "overlap", the mean of both directions) and delay of each actuator.

        A dead band counts as known once each direction's curve has a known knot. The standard
        deviation of a delay is `delay_spacing` if the delay is known, else `max_delay`.
        """
        found = []
        for name, axis in zip(self._names, self.axes, strict=True):
            dead_band = float(np.mean([curve.commands[0] for curve in axis.curves]))
            spread = float(np.mean([curve.covariance[0, 0] for curve in axis.curves])) ** 0.5
            dead_band_known = all(curve.known_speed > 0.0 for curve in axis.curves)
            delay, response = axis.delay, self.settings.response
            deviation = response.delay_spacing if delay.is_known else response.max_delay
            found += [
                Estimate("overlap", name, dead_band, spread, dead_band_known),
                Estimate("delay", name, delay.delay, deviation, delay.is_known),
            ]
        return found

    def _command_valves(self) -> None:
        """Run the law of each actuator and write its valve command to the signals."""
        signals = self._signals
        for j, axis in enumerate(self.axes):
            signals.circuit.actuators["valve_command"][j] = axis.update(
                float(signals.sensors["length"][j]), partial(self._look_ahead, j)
            )

    def _look_ahead(self, j: int, time: float) -> tuple[float, float]:
        """Return length and speed of a piston's reference at a time from now.

        Args:
            j: Index of the actuator.
            time: Time from now, at most the time of the last reference point [s].

        Returns:
            Length of the cylinder [m] and piston speed [m/s], positive in extension.
        """
        k = min(int(time / self._spacing), REFERENCE_POINTS - 2)
        start, end = self._signals.reference[k : k + 2, :, j]
        q, speed, _ = quintic_hermite(
            time - k * self._spacing, self._spacing, tuple(start), tuple(end)
        )
        length, arm, _ = evaluate_linkage_at_angles(self._arrays.linkage[j], np.array([q]))[0]
        return float(length), float(arm * speed)

    def _command_pumps(self) -> None:
        """Command join valves, diverters and the flows of the servo pumps.

        An actuator's flow is A_dir |v| (1 + surplus) plus the leakage of one valve. A_dir is the
        piston area into which oil flows, and v the demanded speed. The pumps that serve the
        actuator deliver equal shares of this flow.

        Each pump also delivers its slip flow at the highest boost pressure, because the line's
        pressure is not known. The command is at most the pump's largest flow. A pump that serves no
        actuator is commanded to 0.

        A join valve is opened if its line draws from the rail (`joins_rail`), else shut. A diverter
        leads to the rail if its module serves an actuator other than its own.
        """
        signals, arrays = self._signals, self._arrays
        circuit, serves = signals.circuit, signals.serves
        rise = arrays.max_boost_pressure - arrays.supply_pressure
        slip = compute_slip_flow(arrays.servo_pump_slip, 1, rise)
        for j in range(len(self.axes)):
            joined = joins_rail(j, signals.modes, circuit.module_home, serves)
            circuit.actuators["join_command"][j] = 1.0 if joined else 0.0
        for k, user in enumerate(serves):
            if user < 0:
                circuit.modules["flow_command"][k] = circuit.modules["to_rail_command"][k] = 0.0
                continue
            speed = self.axes[user].speed
            area = inlet_area(arrays.cap_area[user], arrays.rod_area[user], speed)
            flow = area * abs(speed) * (1.0 + self._gains.pump_surplus) + arrays.leakage_flow
            shared = flow / np.count_nonzero(serves == user) + slip
            most = circuit.constants["servo_pump_flow"][0]
            circuit.modules["flow_command"][k] = min(shared, most)
            circuit.modules["to_rail_command"][k] = float(circuit.module_home[k] != user)
