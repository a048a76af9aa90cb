"""Coordinated control: valves and servo pumps act on one common speed demand.

The valve opens as far as the demanded piston speed requires at the measured pressures. The servo
pumps deliver the flow that the valves are about to take, corrected a little by the pressure error.
Each pump's flow is limited so that the pump can be stopped before its oil overfills the line. The
reference ahead shows how much oil the line will take. On the rail, pumps that are no longer needed
count until they have come to rest.

Lines are charged ahead of a boost, by the prepared modes. A line is joined to the rail softly: the
join valve is throttled to what the line needs until the pressures are equal. The oil that charges a
line comes from the main pump, too, and is limited to what the main pump can spare. Since the valve
uses measured pressures, the servo keeps no pressure margin beyond the plan's.
"""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, field
from typing import ClassVar

from mhsb_control.cascade import (
    CascadeGains,
    CascadeSettings,
    ControlAxis,
    ServoArguments,
    SharedGains,
    build_servo_arguments,
    compute_piston_demands,
    joins_rail,
    set_supply_targets,
)
from mhsb_control.controller import ActuatorReadings, ServoSignals
from mhsb_control.delay_line import describe_uncompensated_delay
from mhsb_control.estimates import collect_estimates
from mhsb_control.line_estimate import update_line_estimates
from mhsb_control.servo_pumps import (
    PumpGains,
    PumpSettings,
    PumpState,
    build_pump_state,
    command_pumps,
    compute_charging_flow_limit,
    feeds_rail,
    observe_line_draws,
    predict_line_volumes,
)
from mhsb_control.spools.lag_estimate import (
    LagEstimates,
    LagSettings,
    accumulate_lag_window,
    advance_spools,
    build_lag_estimates,
    finish_lag_step,
)
from mhsb_control.valve_estimate import (
    EstimatedValve,
    ValveEstimates,
    ValveSettings,
    accumulate_valve_window,
    build_valve_estimates,
    build_valve_records,
    compute_opening,
    shift_opening,
)
from mhsb_model.arm_reports import Estimate
from mhsb_model.circuit.elements import (
    compute_metering_flow,
    compute_null_leakage,
    compute_orifice_flow,
)
from mhsb_model.circuit.quantities import ActuatorState, CircuitConstants, CylinderConstants
from mhsb_model.hydraulics import inlet_area, load_pressure
from mhsb_model.kernels.bound_kernel import bind_kernel
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.modes import BOOSTED_MODES, RAIL_MODES
from mhsb_model.records import Record, Records, create_record
from mhsb_model.schema import Section
from mhsb_model.types import FloatArray, IntArray

_log = logging.getLogger(__name__)

CHARGING_TIME_CONSTANTS = 4.0
"""Time in which a throttled join valve charges its line, in time constants of the valve [-].

A first-order lag of time constant T in a loop with an integrator of time constant 4 T is damped
critically: the shortest time without overshoot."""


@dataclass(frozen=True)
class CoordinationSettings(Record):
    """Tuned numbers of the coordinated controller itself."""

    early_leave_flow_share: float = 0.8
    """Share of a pump's flow up to which a line may leave the rail before its mode ends, 0 … 1.

    A line that has left the rail stays separate up to the full flow of one pump. Origin: chosen.

    30 % smaller and larger, N = 5: no effect on mhsb_arm3 and excavator."""
    max_phase_lag: float = 0.9
    """Largest phase lag of the force loop at ω_F that delays may cause [rad], above 0 … π/2.

    Origin: derivation; a phase margin of 38 degrees remains.

    30 % smaller and larger, N = 5: RMS error −5.0 and −6.5 % (mhsb_arm3; overshoot −0.08 and
    −0.05 MPa), +14.9 and −5.2 % (excavator; overshoot −1.21 and −1.72 MPa)."""
    max_resonant_phase_lag: float = 0.6
    """Largest phase lag of a fast joint's force loop at ω_F that delays may cause [rad], above 0 …
    π/2.

    A fast joint oscillates at 1/T or faster; T is the reaction time. Force feedback that is late by
    more than π/2 drives an oscillation, which only friction damps.
    Origin: derivation; at a delay of π the loop gain is ω_F T/(2 π ζ), 0.95 for a damping ratio ζ
    of 0.1. Before the feedforward share was introduced, with 0.3, 0.44 and 0.6 and a delay of 20
    ms, the RMS error was 1.1, 1.0 and 0.8 mm/m (mhsb_arm3), 2.1, 2.0 and 1.8 mm/m (excavator).

    30 % smaller and larger in the present form: not measured."""
    min_speed_ratio: float = 1.1
    """Share of the reference's speed that may always be demanded of a piston, 1 … 10.

    Origin: chosen; the loops need a speed above the reference's to catch up with it.

    30 % smaller and larger, N = 5: RMS error +53.5 and −17.3 % (mhsb_arm3), +20.1 and +0.5 %
    (excavator; overshoot −2.30 and −0.02 MPa)."""
    idle_flow_share: float = 0.02
    """Share of a pump's flow below which its rail may be shut, 0 … 1.

    Origin: chosen; this remaining flow raises the pressure of the shut rail.

    30 % smaller and larger, N = 5: RMS error −4.3 and −0.9 % (mhsb_arm3), −0.1 and +0.1 %
    (excavator)."""


@dataclass(frozen=True)
class CoordinatedSettings:
    """Tuned numbers of the coordinated controller with its cascade, pumps and estimators."""

    coordination: CoordinationSettings = field(default_factory=CoordinationSettings)
    """Settings of the controller itself."""
    cascade: CascadeSettings = field(default_factory=CascadeSettings)
    """Settings of the cascade and of the load estimates."""
    valves: ValveSettings = field(default_factory=ValveSettings)
    """Settings of the valve estimates and of the inverse valve curve."""
    lags: LagSettings = field(default_factory=LagSettings)
    """Settings of the estimate of the valves' lag."""
    pumps: PumpSettings = field(default_factory=PumpSettings)
    """Settings of the pumps, and of the estimates of lines, pumps and drawn flow."""


class CoordinatedGains(PumpGains, CascadeGains):
    """Gains of the `coordinated` controller."""

    search_ranges: ClassVar[dict[str, tuple[float, float]]] = {
        **CascadeGains.search_ranges,
        **PumpGains.search_ranges,
    }


class CoordinatedController:
    """Controller that drives valves and servo pumps by one demanded piston speed per cylinder.

    Attributes:
        settings: Tuned numbers of every new controller of this class.
    """

    gains_section: type[Section] = CoordinatedGains
    usual_error = 3e-3
    settings: ClassVar[CoordinatedSettings] = CoordinatedSettings()

    def __init__(self, machine: Machine, signals: ServoSignals, gains: CoordinatedGains) -> None:
        """Build servo, pump and valve records, and bind the control kernel to them.

        A line whose join valve is open at the start counts as joined to the rail. The first
        pressure target of each line is its present pressure. A warning is logged if the machine
        file declares a longer delay of commands than this controller can compensate.

        Args:
            machine: The machine as declared in its file (the real one may differ).
            signals: Arrays that the controller reads and writes in each step.
            gains: Gains of this controller, from its section of the machine file.
        """
        if limitation := describe_uncompensated_delay(machine):
            _log.warning("%s", limitation)
        self.preview: float = gains.preview
        settings = self.settings
        cascade = build_servo_arguments(
            machine, signals, gains, estimates_load=True, settings=settings.cascade
        )
        cascade.axes["joined"] = signals.circuit.actuators["join"]
        cascade.axes["supply_target"] = signals.sensors["line_pressure"]
        pumps = build_pump_state(machine, signals, gains, settings.pumps)
        valves = build_valve_estimates(
            build_valve_records(machine, settings.valves),
            signals.valve_overlap,
            machine.config.imperfections.overlaps,
            settings.valves,
            machine.config.simulation.step,
        )
        lags = build_lag_estimates(
            cascade.gains["valve_lag"][0],
            machine.config.circuit.valve_damping,
            machine.config.simulation.step,
            machine.arrays.max_piston_speed,
            settings.lags,
        )
        self._estimators = (
            machine.actuator_names,
            cascade.load,
            valves,
            lags,
            pumps.lines,
            pumps.drives,
            settings.cascade.load,
            settings.pumps,
        )
        own = create_record(settings.coordination)
        self._control = bind_kernel(run_coordinated_step, cascade, valves, lags, pumps, own)

    def update(self) -> None:
        """Compute all commands for the next step, and write them into the signals."""
        self._control()

    @property
    def estimates(self) -> list[Estimate]:
        """All estimates of the machine's parameters so far."""
        return collect_estimates(*self._estimators)


@kernel(borrows=True)
def run_coordinated_step(
    s: ServoArguments,
    v: ValveEstimates,
    lags: LagEstimates,
    p: PumpState,
    own: Records[CoordinationSettings],
) -> None:
    """Run one step of the coordinated controller.

    A step computes, in this order:

    1. the demanded piston speeds;
    2. for each actuator the valve estimates (with the last step's opening), the valve command and
        the pressure targets of its line;
    3. the estimates of the valves' lag, oil compressibility and leakage;
    4. the oil that the lines will draw, and what they draw now;
    5. the piston speeds that the pumps can supply;
    6. the join valves;
    7. the pump commands;
    8. the gains of the position and force loops, which a long estimated delay or lag lowers.

    Args:
        s: Signals, circuit, axes and estimates of the servo. Writes `axes`, `valve_lag` and
            `reaction_time` of `gains`, `command_times`, and the commands of `actuators` and
            `modules` in place.
        v: Estimates of the valves, updated in place.
        lags: Estimate of the valves' lag, updated in place.
        p: State of the pumps, updated in place.
        own: Tuned numbers of the controller itself, CoordinationSettings[1].
    """
    settings, delay, step = own[0], p.drives.record[0].delay, s.gains[0].step
    compute_piston_demands(s)
    ends, is_used = lags.record[0].steps == lags.settings[0].window_steps, False
    for j in range(len(s.axes)):
        axis, sensor, cylinder = s.axes[j], s.sensors[j], s.cylinders[j]
        force = sensor.cap_pressure * cylinder.cap_area - sensor.rod_pressure * cylinder.rod_area
        shift_opening(v.records[j], v.openings[j], delay, s.gains[0].valve_lag, step)
        advance_spools(lags, v, j, sensor.length, force, step)
        if ends:
            used = accumulate_lag_window(lags, v, j, sensor.length, force, axis.stiffness)
            is_used = is_used or used
        accumulate_valve_window(v, j, axis.speed, sensor.length, force, axis.stiffness, step)
        compute_valve_command(
            axis,
            sensor,
            cylinder,
            s.constants,
            s.actuators[j],
            v.records[j],
            v.overlap[j],
            v.settings[0],
            s.gains[0].reaction_time,
        )
        select_supply_targets(axis, sensor, cylinder, s.constants, s.gains, s.modes[j])
    finish_lag_step(lags, is_used, delay)
    s.gains[0].valve_lag = lags.record[0].lag
    update_line_estimates(s, p.lines, p.gains[0].settings.lines)
    predict_line_volumes(s, p)
    observe_line_draws(s, p)
    limit_speeds_by_pumps(s, p, settings.min_speed_ratio)
    p.charging_flow_left[0] = compute_charging_flow_limit(s, p)
    control_join_valves(s, p, settings)
    command_pumps(s, p)
    limit_gains_by_delay(s, p, settings)


@kernel(borrows=True)
def limit_gains_by_delay(s: ServoArguments, p: PumpState, settings: CoordinationSettings) -> None:
    """Limit the gains of all axes to what the reaction time and the valves' flow allow.

    The reaction time T is the time from a measurement to its effect at the valve. It is the sum of
    a control period, the lag of the spool and the estimated delay of commands. The estimated
    compressibility of the oil, relative to the machine file's and at most 1, also limits the gains.
    `limit_axis_gains` has the equations.

    Args:
        s: Signals, circuit, axes and estimates of the servo. Writes `reaction_time` [s] of `gains`,
            and `force_bandwidth`, `position_gain` and `integral_gain` of all axes, in place. Also
            writes `command_times` [s]: the times until a valve command acts, until the valve has
            crossed its overlap, and until a pump command acts.
        p: State of the pumps with the estimates of delay and compressibility.
        settings: Tuned numbers of the controller itself.
    """
    drives, gains = p.drives.record[0], s.gains[0]
    delay, times = gains.step + drives.delay * drives.step, s.command_times
    gains.reaction_time = delay + gains.valve_lag
    crossing = gains.settings.crossing_lags * gains.valve_lag
    times[0], times[1], times[2] = gains.reaction_time, gains.reaction_time + crossing, delay
    compressibility = min(p.lines.estimate[0], 1.0)
    ratio = gains.settings.max_position_gain_ratio
    for j in range(len(s.axes)):
        limit_axis_gains(s.axes[j], gains.reaction_time, compressibility, ratio, settings)


@kernel(borrows=True)
def limit_axis_gains(
    axis: ControlAxis,
    reaction_time: float,
    compressibility: float,
    max_position_gain_ratio: float,
    settings: CoordinationSettings,
) -> None:
    """Limit the gains of an axis to what its reaction time T and its valve's flow allow.

        ω_F ≤ c φ/T,    k_p ≤ ratio ω_F,    k_p ≤ ω_F/(1 + w),    k_i ∝ k_p²

    φ is the phase lag `max_phase_lag`. ω is the joint's highest natural frequency. If ω T ≥ 1, φ is
    at most `max_resonant_phase_lag`. Late measurements make the oil appear softer by the factor 1 +
    w (`compute_feedforward_share`). ratio is `max_position_gain_ratio`. No gain exceeds the value
    that `build_axis_records` has set.

    Args:
        axis: State of the cylinder's control axis. Writes `force_bandwidth` (ω_F), `position_gain`
            (k_p) and `integral_gain` (k_i) in place.
        reaction_time: T, time from a measurement to its effect at the valve [s].
        compressibility: c, compressibility of the oil relative to the machine file's, at most 1.
        max_position_gain_ratio: Largest k_p/ω_F.
        settings: Tuned numbers of the controller itself.
    """
    phase = settings.max_phase_lag
    if axis.highest_frequency * reaction_time >= 1.0:
        phase = min(phase, settings.max_resonant_phase_lag)
    axis.force_bandwidth = min(axis.max_force_bandwidth, phase * compressibility / reaction_time)
    softening = 1.0 + compute_feedforward_share(axis, reaction_time)
    ratio = min(max_position_gain_ratio, 1.0 / softening)
    axis.position_gain = min(axis.max_position_gain, ratio * axis.force_bandwidth)
    share = axis.position_gain / axis.max_position_gain
    axis.integral_gain = share * share * axis.max_integral_gain


@kernel
def compute_feedforward_share(axis: ControlAxis, reaction_time: float) -> float:
    """Compute the share w of the feedforward in the force for which a valve opens.

        w = κ T/(1 + κ T)

    A valve opening is computed for the force (1 − w) F + w F_ff. F is the measured cylinder force,
    and F_ff the feedforward force. The reason is damping. At a constant opening, the flow falls as
    F rises, which damps oscillations of F at the rate κ. With w = 0 the opening follows the
    measured F, so that the flow is constant, and this damping is lost. If F is measured with the
    delay T, the oil also appears softer by the factor 1 + κ T. With the share w, a damping of κ w
    remains, and the oil appears softer only by the factor 1 + w.

    Args:
        axis: State of the cylinder's control axis. Reads `flow_damping` (κ) [1/s].
        reaction_time: T, time from a measurement to its effect at the valve [s].

    Returns:
        w, 0 … 1.
    """
    late = axis.flow_damping * reaction_time
    return late / (1.0 + late)


@kernel(inline="always")
def compute_speed_gain(
    axis: ControlAxis,
    cylinder: CylinderConstants,
    c: CircuitConstants,
    pressures: tuple[float, float, float],
    smallest: float,
) -> tuple[float, float]:
    """Compute the piston speed per valve opening, and the damping that the valve's flow causes.

    The valve's flow coefficient is that of the machine file, not an estimated one.

        G = K [A (β/V_A) S(Δp_A) + a (β/V_B) S(Δp_B)]/k_h
        κ = |x| K [(A β/V_A)² S'(Δp_A) + (a β/V_B)² S'(Δp_B)]/k_h

    x is the valve opening and k_h the stiffness of the oil [N/m]. A and a are the piston areas on
    the cap side and the rod side. β/V_A and β/V_B are the stiffnesses of the oil in the two
    chambers [Pa/m³]. For each chamber the valve has one edge to the line and one to the tank. Δp_A
    and Δp_B are the pressure drops over the edges that are open during a motion in the demanded
    direction. S(Δp) is √Δp, but linear below the laminar pressure and constant above the drop that
    a pressure compensator keeps. S' is its derivative.

    Args:
        axis: State of the cylinder's control axis, with the demanded speed and stiffnesses.
        cylinder: Areas and flow coefficient K of the cylinder's valve.
        c: Constants of the circuit.
        pressures: Pressures of the line, the cap side and the rod side [Pa].
        smallest: Lower bound on K S(Δp), the flow through a fully open edge [m³/s].

    Returns:
        G [m/s], and κ/|x| [1/s]: the rate κ at which the force decays, divided by the opening.
    """
    line, cap_pressure, rod_pressure = pressures
    k = cylinder.valve_coefficient
    cap_gain = cylinder.cap_area * axis.cap_stiffness
    rod_gain = cylinder.rod_area * axis.rod_stiffness
    if axis.demand >= 0.0:
        cap_drop, rod_drop = line - cap_pressure, rod_pressure - c.tank_pressure
    else:
        cap_drop, rod_drop = cap_pressure - c.tank_pressure, line - rod_pressure
    laminar, kept = c.laminar_pressure, c.compensated_drop
    cap_flow, cap_slope = compute_metering_flow(k, max(cap_drop, 0.0), laminar, kept)
    rod_flow, rod_slope = compute_metering_flow(k, max(rod_drop, 0.0), laminar, kept)
    gain = cap_gain * max(cap_flow, smallest) + rod_gain * max(rod_flow, smallest)
    decay = cap_gain * cap_gain * cap_slope + rod_gain * rod_gain * rod_slope
    return gain / axis.stiffness, decay / axis.stiffness


@kernel(borrows=True)
def compute_valve_command(
    axis: ControlAxis,
    sensor: ActuatorReadings,
    cylinder: CylinderConstants,
    constants: Records[CircuitConstants],
    actuator: ActuatorState,
    valve: EstimatedValve,
    overlap: FloatArray,
    settings: ValveSettings,
    reaction_time: float,
) -> None:
    """Compute the valve command that produces the demanded piston speed.

    The opening is x = u/G. The flows over both metering edges then change the cylinder force F by
    dF/dt = k_h (u − v). u is the demanded piston speed, v the actual one [m/s], and k_h the
    stiffness of the oil. G is the piston speed per opening (`compute_speed_gain`). It is computed
    at pressures that belong to the force F + w (F_ff − F). They are the measured pressures, shifted
    to this force by the stiffness of each chamber. F_ff is the feedforward force, and w the share
    of `compute_feedforward_share`. `compute_opening` corrects for the estimated gain and overlap.

    The valve stays shut if the line pressure is below the load pressure p_L of the measured force.
    An open valve would let the load sink. Above p_L, the command rises in proportion to the line
    pressure; it has its full value at p_L plus the laminar pressure (below which flow is laminar).
    After a motion in the other direction, a chamber may have a higher pressure than the line; this
    does not shut the valve.

    Args:
        axis: State of the cylinder's control axis, with u and stiffnesses. Writes `flow_damping`
            (κ) [1/s] and `is_saturated` in place. `is_saturated` is 1 if the load keeps the valve
            partly or fully shut, the valve is fully open, or the pumps limit the demand.
        sensor: Measured length [m] and pressures [Pa] of the actuator.
        cylinder: Areas and flow coefficient K of the cylinder's valve.
        constants: Constants of the circuit, one record.
        actuator: ActuatorState of the circuit's actuator. Writes `valve_command`, −1 … 1, in place;
            positive extends.
        valve: Estimates and window of the valve. Writes `speed_gain` (G at the measured pressures)
            [m/s], `driving_pressure` (line pressure minus p_L) [Pa] and `opening` (x) in place.
            `opening` is 0 if the load keeps the valve partly or fully shut, so that the estimator
            does not use it.
        overlap: Overlaps extending and retracting that are compensated, as shares of the spool's
            stroke, float64[2].
        settings: Tuned numbers of the inverse.
        reaction_time: T, time from a measurement to its effect at the valve [s].
    """
    c = constants[0]
    k, cap, rod = cylinder.valve_coefficient, cylinder.cap_area, cylinder.rod_area
    force = cap * sensor.cap_pressure - rod * sensor.rod_pressure
    direction = 1.0 if axis.demand >= 0.0 else -1.0
    carried = load_pressure(cap, rod, c.tank_pressure, force, direction)
    pressures = (sensor.line_pressure, sensor.cap_pressure, sensor.rod_pressure)
    least_drop = settings.min_pressure_drop * c.laminar_pressure
    smallest, _ = compute_orifice_flow(k, least_drop, c.laminar_pressure)
    valve.speed_gain, decay = compute_speed_gain(axis, cylinder, c, pressures, smallest)
    gain = valve.speed_gain
    axis.flow_damping = min(abs(axis.demand) / gain, 1.0) * decay
    share = compute_feedforward_share(axis, reaction_time)
    away = share * (axis.feedforward - force) / axis.stiffness
    pressures = (
        sensor.line_pressure,
        sensor.cap_pressure + cap * axis.cap_stiffness * away,
        sensor.rod_pressure - rod * axis.rod_stiffness * away,
    )
    gain, _ = compute_speed_gain(axis, cylinder, c, pressures, smallest)
    opening = compute_opening(
        gain * valve.gain, overlap, axis.demand, axis.speed_to_cross, valve.crossing_speed
    )
    valve.driving_pressure = sensor.line_pressure - carried
    gate = min(max(valve.driving_pressure / c.laminar_pressure, 0.0), 1.0)
    actuator.valve_command = gate * min(max(opening, -1.0), 1.0)
    valve.opening = actuator.valve_command if gate == 1.0 else 0.0
    held = gate < 1.0 or abs(opening) >= 1.0 or abs(axis.demand) >= axis.deliverable_speed
    axis.is_saturated = 1.0 if held else 0.0


@kernel(borrows=True)
def select_supply_targets(
    axis: ControlAxis,
    sensor: ActuatorReadings,
    cylinder: CylinderConstants,
    constants: Records[CircuitConstants],
    gains: Records[SharedGains],
    mode: int,
) -> None:
    """Set the pressure targets of a line according to its mode.

    In DB and SB (boosted modes), the targets are the supply pressures that the motion needs
    (`set_supply_targets`). In mode N, both targets are the measured line pressure, but at least the
    main pump's pressure P_S.

    Args:
        axis: State of the cylinder's control axis. Writes in place `supply_target`, the pressure to
            be kept now, and `target_ahead`, the pressure needed at the preview point, a fixed time
            ahead [Pa].
        sensor: Measured length [m] and pressures [Pa] of the actuator.
        cylinder: Areas and flow coefficient of the cylinder's valve.
        constants: Constants of the circuit, one record.
        gains: Quantities that all axes share, SharedGains[1].
        mode: Prepared mode of the actuator: the mode in force, or already the boosted mode that
            comes within the controller's preview.
    """
    if BOOSTED_MODES[mode]:
        set_supply_targets(axis, cylinder, constants, gains)
    else:
        axis.supply_target = max(sensor.line_pressure, constants[0].supply_pressure)
        axis.target_ahead = axis.supply_target


@kernel(inline="always")
def limit_speeds_by_pumps(s: ServoArguments, p: PumpState, min_speed_ratio: float) -> None:
    """Compute the largest piston speeds that the pumps of boosted lines can supply.

        |u|_max = (n Q_max − leakage − slip − flow of other axes on the rail)/A_dir

    For a line on the rail, n is the number of pumps that feed the rail; for other lines it is 1.
    A_dir is the piston area that the supply fills. The limit is at least `min_speed_ratio` times
    the reference's speed. It is inf for a line without boost (`line_flow` 0). Without a limit, a
    line would lose pressure. Its pumps would then run at full speed and overshoot when the piston
    has caught up. The limit applies in the next step.

    Args:
        s: Signals, circuit, axes and estimates of the servo. Writes `deliverable_speed` of all axes
            [m/s] in place.
        p: State of the pumps. Reads the leakage estimates in `lines`.
        min_speed_ratio: Multiple of the reference's speed that may always be demanded.
    """
    axes, full = s.axes, s.constants[0].servo_pump_flow
    pumps, diverted = 0, p.gains[0].settings.lines.open_opening
    shared = p.lines.fed[len(axes), 2]
    for k in range(len(s.modules)):
        user: int = s.serves[k]
        if user >= 0 and feeds_rail(s.modules[k], s.module_home[k], user, axes, diverted):
            pumps += 1
    for j in range(len(axes)):
        if axes[j].joined > 0.0:
            shared += (
                compute_reference_flow(axes[j], s.cylinders[j])
                + p.lines.estimate[1 + j] * axes[j].leakage
                + p.lines.fed[j, 2]
            )
    for j in range(len(axes)):
        axis, cylinder = axes[j], s.cylinders[j]
        if axis.line_flow == 0.0:
            axis.deliverable_speed = math.inf
            continue
        left = full - p.lines.estimate[1 + j] * axis.leakage - p.lines.fed[j, 2]
        if axis.joined > 0.0:
            left = pumps * full - shared + compute_reference_flow(axis, cylinder)
        area = inlet_area(cylinder.cap_area, cylinder.rod_area, axis.demand)
        axis.deliverable_speed = max(left / area, min_speed_ratio * abs(axis.speed))


@kernel
def compute_reference_flow(axis: ControlAxis, cylinder: CylinderConstants) -> float:
    """Compute the flow that the reference's piston speed takes from its line.

    Args:
        axis: State of the cylinder's control axis, with the speed of the reference.
        cylinder: Areas of the cylinder.

    Returns:
        A_dir |v_ref| [m³/s], without leakage: the area that the supply fills times the piston
        speed.
    """
    return inlet_area(cylinder.cap_area, cylinder.rod_area, axis.speed) * abs(axis.speed)


@kernel(inline="always")
def control_join_valves(s: ServoArguments, p: PumpState, settings: CoordinationSettings) -> None:
    """Open, throttle or shut the join valves of all lines, and set the rail's pressure targets.

    A line draws from the rail if its mode is SB, or if a spare module or another line's module
    serves its actuator (`joins_rail`). The line counts as joined once its pressure and the rail's
    differ by less than `joined_drop`. Before that, its join valve is throttled to the sum of two
    flows. The first is what the line needs beyond the flow of its own pump. The second is the
    charging flow, which raises the line's pressure; it is subtracted from `p.charging_flow_left`.
    The rail's targets are the highest targets of the lines that are joined or about to join.

    The join valve of a line that no longer draws from the rail is shut. `may_leave_early` says when
    it is shut earlier. If no line draws from the rail any more, all lines stay joined until the
    rail's pumps have nearly stopped (`idle_flow_share`). Otherwise the oil of these pumps would
    raise the pressure of the shut rail. While a join valve closes, the rail's targets are limited
    so that no more flow passes the valve than the line draws. This limit is never below
    `rail_before`, the rail's pressure before the valve began to close.

    Args:
        s: Signals, circuit, axes and estimates of the servo. Writes `joined` of all axes and
            `join_command` of all actuators in place.
        p: State of the pumps. Writes `rail_target` [Pa] and `rail_before` [Pa], and reduces
            `charging_flow_left` [m³/s], in place.
        settings: Tuned numbers of the controller itself.
    """
    axes, actuators, modules = s.axes, s.actuators, s.modules
    modes, serves, module_home, rail_target = s.modes, s.serves, s.module_home, p.rail_target
    c, rail_pressure = s.constants[0], s.rail_pressure[0]
    rail_flow = 0.0
    for k in range(len(modules)):
        rail_flow += modules[k].flow * modules[k].to_rail
    coasting, highest = rail_flow >= settings.idle_flow_share * c.servo_pump_flow, 0.0
    for j in range(len(axes)):
        if joins_rail(j, modes, module_home, serves):
            coasting = False
        if axes[j].joined > 0.0 and BOOSTED_MODES[modes[j]]:
            highest = max(highest, axes[j].supply_target)
    shut_opening = p.gains[0].settings.lines.shut_opening
    max_rail_pressure = math.inf
    rail_target[:] = 0.0
    for j in range(len(axes)):
        axis = axes[j]
        leaves = not joins_rail(j, modes, module_home, serves)
        leaves_early = may_leave_early(s, p, j, highest, settings.early_leave_flow_share)
        leaves = leaves or leaves_early
        if leaves and (leaves_early or not coasting):
            axis.joined = 0.0
        if axis.joined > 0.0 or not leaves:
            rail_target[0] = max(rail_target[0], axis.supply_target)
            rail_target[1] = max(rail_target[1], axis.target_ahead)
        if leaves:
            actuators[j].join_command = axis.joined
            if axis.joined == 0.0 and actuators[j].join > shut_opening:
                cylinder = s.cylinders[j]
                area = inlet_area(cylinder.cap_area, cylinder.rod_area, axis.demand)
                drawn = axis.leakage + area * abs(axis.demand)
                passing = drawn / (c.switching_coefficient * actuators[j].join)
                max_rail_pressure = min(max_rail_pressure, axis.supply_target + passing * passing)
        else:
            actuators[j].join_command = join_line(s, p, j)
    if max_rail_pressure == math.inf:
        p.rail_before[0] = rail_pressure
    max_rail_pressure = max(max_rail_pressure, p.rail_before[0])
    rail_target[0] = min(rail_target[0], max_rail_pressure)
    rail_target[1] = min(rail_target[1], max_rail_pressure)


@kernel(borrows=True)
def may_leave_early(
    s: ServoArguments, p: PumpState, j: int, highest: float, flow_share: float
) -> bool:
    """Return whether a line may leave the rail before its mode ends.

    Three conditions must hold:

    - Another boosted line on the rail needs a pressure that is higher by more than `joined_drop`.
    - The line's mode will not be SB (shared boost) at the preview point, a fixed time ahead.
    - One pump can supply the line's flow, less the leakage that the lower pressure will save. While
      the line is joined to the rail, only the share `flow_share` of the pump's full flow counts.

    Args:
        s: Signals, circuit, axes and estimates of the servo.
        p: State of the pumps. Reads the leakage estimates in `lines`.
        j: Index of the line.
        highest: Highest pressure target of the boosted lines that are joined to the rail [Pa].
        flow_share: Share of a pump's full flow that counts for a joined line, 0 … 1.
    """
    axis, c = s.axes[j], s.constants[0]
    lower = axis.supply_target < highest - p.gains[0].settings.lines.joined_drop
    if not lower or RAIL_MODES[s.modes_ahead[j]]:
        return False
    leakage = compute_null_leakage(c, axis.supply_target - c.tank_pressure)
    excess_leakage = p.lines.estimate[1 + j] * (axis.leakage - leakage)
    most = flow_share if axis.joined > 0.0 else 1.0
    return axis.line_flow - excess_leakage < most * c.servo_pump_flow


@kernel(borrows=True)
def join_line(s: ServoArguments, p: PumpState, j: int) -> float:
    """Compute the opening of a line's join valve, and join the line if the pressures agree.

    The pressures of line and rail agree if they differ by less than `joined_drop`.

    Args:
        s: Signals, circuit, axes and estimates of the servo. Writes `joined` of the axis in place.
        p: State of the pumps. Reduces `charging_flow_left` [m³/s] in place.
        j: Index of the line, which draws from the rail.

    Returns:
        Opening of the join valve, 0 … 1. It is 1 if the line is joined. Before that, it is 0 if the
        rail's pressure is not above the line's; otherwise the valve lets two flows pass: the flow
        that the line needs beyond the flow of its own pump, and the flow that raises the line's
        pressure to its target.
    """
    axis, c, line_pressure = s.axes[j], s.constants[0], s.sensors[j].line_pressure
    drop = s.rail_pressure[0] - line_pressure
    if abs(drop) < p.gains[0].settings.lines.joined_drop:
        axis.joined = 1.0
    lacking = c.line_capacity * (axis.supply_target - line_pressure)
    charge = min(
        max(0.0, lacking / (CHARGING_TIME_CONSTANTS * c.switching_time)),
        p.charging_flow_left[0],
    )
    own = c.servo_pump_flow if has_own_pump(j, s.module_home, s.serves) else 0.0
    largest, _ = compute_orifice_flow(c.switching_coefficient, max(drop, 1.0), c.laminar_pressure)
    throttle = 0.0
    if drop > 0.0:
        throttle = min(1.0, (max(0.0, axis.line_flow - own) + charge) / largest)
        p.charging_flow_left[0] -= charge
    return max(axis.joined, throttle)


@kernel(borrows=True)
def has_own_pump(j: int, module_home: IntArray, serves: IntArray) -> bool:
    """Return whether the module of an actuator's own line serves this actuator.

    Args:
        j: Index of the actuator.
        module_home: Actuator to whose line each module belongs, int64[m]; −1 for a spare.
        serves: Actuator that each module serves, int64[m]; −1 if idle.

    Returns:
        True if the actuator's own module serves it.
    """
    found = False
    for k in range(len(serves)):
        found = found or (serves[k] == j and module_home[k] == j)
    return found
