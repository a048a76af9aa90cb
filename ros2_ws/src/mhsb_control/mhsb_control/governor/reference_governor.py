"""The reference governor: boosts actuators and slows the plan before the arm sags.

The plan's modes and timing assume the machine of the file. The governor uses measurements. For each
actuator,

    p_L = (F + a p_T)/A extending, (−F + A p_T)/a retracting    load pressure, F = p_A A − p_B a
    r   = p̂ + T ṗ̂ − p_L − m(v)                                  reserve [Pa] in T, at full speed

p̂ is the filtered pressure of its line, and ṗ̂ its rate, which counts only while it is negative.
m(v) is the drop over the fully open valve at the piston speed v, and T the prediction time. If the
reserve that the main pump leaves in mode N is too small, the actuator is boosted. The boost ends
when the reserve has been large for a while. If boost does not suffice or does not act yet, the plan
is slowed. The rate of the plan falls with the smallest reserve, with a valve that stays nearly
open, and with the tip's distance from its reference. A plan is held only if the line of a moving
actuator has almost no pressure beyond p_L. Otherwise the rate stays at a small value, and the arm
still moves.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

from mhsb_control.controller import ActuatorReadings, ServoSignals
from mhsb_control.machine_scales import compute_braking_rate
from mhsb_control.reference import ReferencePreview
from mhsb_control.speed_scaling import ScalingSettings, SpeedScaling, update_rate
from mhsb_model.circuit.quantities import ActuatorState, CircuitConstants, CylinderConstants
from mhsb_model.hydraulics import compute_pressure_without_margin, load_pressure
from mhsb_model.kernels.kernel import kernel
from mhsb_model.kinematics import add_extension, get_turn_angle
from mhsb_model.linkages.linkage import evaluate_linkage
from mhsb_model.machine import Machine
from mhsb_model.modes import BOOSTED_MODES, Mode
from mhsb_model.records import Record, Records, create_record, create_records
from mhsb_model.statics import Chain, get_chain
from mhsb_model.types import FloatArray, ModeArray

START_PREVIEW_POINT = 1
"""Index of the reference point that shows whether a motion is about to start."""

MOVING_SPEED, STARTING_SPEED = 1e-5, 1e-3
"""Piston speeds [m/s] above which an actuator counts as moving: at present, and ahead."""


@dataclass(frozen=True)
class GovernorSettings(Record):
    """Tuned numbers of the reference governor.

    The reserve of an actuator is the pressure r of the module's docstring.
    """

    filter_gain: float = 0.1
    """α of the α-β filter for measured values, above 0 … 1, with β = α²/(2 − α).

    Origin: a time constant of 10 ms at 1 kHz; pressures oscillate at 5 Hz and more.

    30 % smaller and larger, N = 5: RMS error −2.2 and −3.9 % (mhsb_arm3; overshoot −0.08 and
    +0.00 MPa), −5.9 and −2.7 % (excavator; overshoot −1.09 and −1.90 MPa)."""
    boosted_smoothing: float = 0.03
    """Time constant for the reserve of a boosted line [s], 0.001 … 1.

    Origin: the line's pump covers shorter shortfalls.

    30 % smaller and larger, N = 5: RMS error +0.1 and +0.1 % (mhsb_arm3), +10.6 and +0.9 %
    (excavator; overshoot −1.53 and −1.07 MPa, falls +1 and +0)."""
    prediction_time: float = 0.04
    """Prediction time T [s], 0 … 1.

    Origin: about what a pump takes to charge a line.

    30 % smaller and larger, N = 5: RMS error +0.2 and −0.4 % (mhsb_arm3), +2.3 and −1.4 %
    (excavator; overshoot −2.24 and −2.32 MPa)."""
    boost_below: float = -3e4
    """Reserve in mode N below which an actuator is boosted [Pa], −1e7 … 1e7.

    Origin: a plan may use all of P_S, of which the main pump's droop and the check valve take
    0.025 MPa.

    30 % smaller and larger, N = 5: RMS error −5.0 and −3.0 % (mhsb_arm3; overshoot −0.06 and
    −0.05 MPa), −1.0 and −6.1 % (excavator; overshoot −1.90 and −2.55 MPa)."""
    boost_after: float = 0.01
    """Time for which the reserve has to stay below `boost_below` [s], 0 … 1.

    Origin: chosen; a tenth of a pressure oscillation at 10 Hz.

    30 % smaller and larger, N = 5: RMS error −0.8 and −2.1 % (mhsb_arm3), −1.4 and −3.6 %
    (excavator; overshoot −0.20 and −0.51 MPa)."""
    keep_below: float = -1.5e5
    """Reserve in mode N below which a boost continues although the plan ends it [Pa], −1e7 … 0.

    Origin: a line that lacks less than this in mode N loses almost no pressure during
    `boost_after`. The plan lets inertia use up its margin, and the measured reserve is late.

    30 % smaller and larger, N = 5: no effect on mhsb_arm3 and excavator. With −2e5, a boosted
    piston of mhsb_arm3 that stalls 0.5 mm below its reference gets no boost in place of its
    plan's."""
    release_above: float = 4.5e5
    """Reserve in mode N above which a requested boost ends [Pa], 0 … 1e7.

    Origin: chosen; the distance to `boost_below` keeps boost from flickering.

    30 % smaller and larger, N = 5: RMS error −3.3 and −3.9 % (mhsb_arm3), −3.5 and −3.2 %
    (excavator; overshoot −0.48 and −0.08 MPa)."""
    release_after: float = 0.3
    """Time for which the reserve has to stay above `release_above` [s], 0 … 10.

    Origin: chosen; the planner merges shorter gaps between boosts as well.

    30 % smaller and larger, N = 5: RMS error −4.1 and −3.2 % (mhsb_arm3), −8.0 and −3.5 %
    (excavator; overshoot −0.58 and −0.58 MPa)."""
    full_rate_reserve: float = -8e4
    """Reserve in mode N above which the plan runs at full speed [Pa], −1e7 … 1e7.

    Origin: chosen, below `boost_below`, so that boost comes before slowing.

    30 % smaller and larger, N = 5: RMS error −4.6 and 0 % (mhsb_arm3), +2.1 and +2.2 %
    (excavator; overshoot +0.02 and −1.48 MPa)."""
    zero_rate_reserve: float = -2e5
    """Reserve in mode N below which the plan stands still [Pa], below `full_rate_reserve`.

    The speed is linear in between. Origin: chosen.

    30 % smaller and larger, N = 5: RMS error 0 and 0 % (mhsb_arm3), +0.1 and −0.2 % (excavator;
    overshoot +0.08 and −1.25 MPa)."""
    boosted_full_reserve: float = -0.5e5
    """Reserve of a boosted line above which the plan runs at full speed [Pa], −1e7 … 1e7.

    Origin: chosen; a boosted line is kept at what is needed.

    30 % smaller and larger, N = 5: RMS error −3.6 and −0.3 % (mhsb_arm3), −2.8 and +1.8 %
    (excavator; overshoot −0.40 and +0.11 MPa)."""
    boosted_zero_reserve: float = -2.5e5
    """Reserve of a boosted line below which the plan stands still [Pa].

    The speed is linear in between. Origin: chosen.

    30 % smaller and larger, N = 5: RMS error +0.1 and 0 % (mhsb_arm3), +8.0 and +3.5 %
    (excavator; overshoot +0.19 and −2.01 MPa, falls +1 and +0)."""
    full_rate_opening: float = 0.7
    """Filtered valve opening below which the plan runs at full speed, 0 … 1.

    Origin: chosen. A valve that stays nearly open has no flow left to catch up with.

    Distance to 1 30 % smaller and larger, N = 5: RMS error +3.9 and −4.6 % (mhsb_arm3), +2.9 and
    −12.6 % (excavator; overshoot −1.98 and −2.79 MPa, falls +0 and −1)."""
    zero_rate_opening: float = 0.9
    """Filtered valve opening above which the plan stands still, above `full_rate_opening`.

    The speed is linear in between. Origin: chosen.

    Distance to 1 30 % smaller and larger, N = 5: RMS error +0.4 and −0.4 % (mhsb_arm3), −3.5 and
    +1.4 % (excavator; overshoot −2.55 and −0.62 MPa)."""
    opening_filter_time: float = 0.1
    """Time constant of the filter of the valve opening [s], 0.001 … 10.

    Origin: chosen; longer than the opening of a valve that starts a motion.

    30 % smaller and larger, N = 5: RMS error −4.7 and +3.1 % (mhsb_arm3), −1.8 and +2.4 %
    (excavator; overshoot −1.37 and −0.82 MPa)."""
    hold_error_ratio: float = 1.7
    """Distance of the tip from its reference at which the rate is least, in usual errors, 1 … 100.

    Up to one usual error the plan runs at full speed. Origin: chosen.

    30 % smaller and larger, N = 5: RMS error −15.0 and +2.3 % (mhsb_arm3; overshoot +0.08 and
    +0.00 MPa), 0 and −0.7 % (excavator; overshoot +0.06 and −0.33 MPa)."""
    min_rate: float = 0.05
    """Smallest rate of a plan while the arm can still move, however far the tip is behind, 0 … 1.

    A plan below this rate counts as held. Origin: chosen. A reference that stood still would stop
    the integral and the estimates that are to move the arm.

    30 % smaller and larger, N = 5: RMS error −3.9 and −3.0 % (mhsb_arm3), −3.7 and −0.7 %
    (excavator; overshoot +0.15 and −0.14 MPa)."""
    min_driving_pressure: float = 5e4
    """Smallest pressure beyond the load pressure p_L with which a line can still move its actuator
    [Pa].

    A plan is held only if a line has less. Range 0 … 1e7. Origin: the laminar pressure of the
    suite's valves.

    30 % smaller and larger, N = 5: RMS error −3.8 and −0.2 % (mhsb_arm3), −1.3 and −0.9 %
    (excavator)."""
    lift_error_ratio: float = 0.9
    """Distance of the tip from its reference beyond which a load has sagged, in usual errors, 0 …
    100.

    A sagged load has to be lifted back, even if the reference lowers it. Origin: chosen, below the
    one usual error from which the plan is slowed.

    30 % smaller and larger, N = 5: RMS error −3.0 and +0.1 % (mhsb_arm3), +1.5 and +3.5 %
    (excavator; overshoot +0.53 and −0.70 MPa)."""
    lifting_pressure: float = 1e5
    """Pressure beyond the holding pressure that counts as needed for lifting [Pa], 0 … 1e7.

    Origin: friction of a stalled piston, which is under the full line pressure.

    30 % smaller and larger, N = 5: RMS error −0.6 and −4.0 % (mhsb_arm3; overshoot −0.06 and
    −0.05 MPa), +1.6 and +1.3 % (excavator; overshoot +0.02 and −1.34 MPa)."""
    scaling: ScalingSettings = field(default_factory=ScalingSettings)
    """Tuned numbers of the speed scaling."""


class GovernedActuator(Record):
    """State of the governor for one actuator."""

    line: float
    """Filtered line pressure [Pa]."""
    force: float
    """Filtered cylinder force [N]."""
    deviation: float
    """Deviation of the joint from its reference [rad or m]."""
    opening: float
    """Filtered opening of the valve beyond its overlap, 0 … 1."""
    reserve: float
    """Reserve in the actuator's present mode [Pa]."""
    allowed_rate: float
    """Rate of the speed scaling that this actuator allows, 0 … 1."""
    reserve_in_n: float
    """Reserve that the actuator has, or would have, in mode N [Pa]."""
    driving_pressure: float
    """Line pressure beyond the load pressure of its motion [Pa]; inf if it does not move."""
    condition_time: float
    """Time for which the condition for a change of the request has lasted [s]."""
    requested_mode: int
    """Mode that the governor requests: N or DB."""


class GovernorTotals(Record):
    """State of the governor for the whole arm."""

    step: float
    """Control period [s]."""
    usual_error: float
    """Normal distance of the tip from its reference [m]."""
    max_slowing: float
    """Largest rate at which the rate of the speed scaling may fall [1/s]."""
    supply: float
    """Lowest pressure of the lines in mode N, filtered [Pa]."""
    supply_rate: float
    """Rate of change of `supply` [Pa/s]."""
    error: float
    """Distance of the tip from its reference [m]."""
    error_behind: float
    """Distance of the tip from its reference, without the component ahead of it [m]."""
    is_initialized: float
    """0 until the filters are initialised, then 1."""
    slowings: float
    """Number of times that the rate began to fall."""
    slowed: float
    """Total time at a reduced rate [s]."""
    held: float
    """Time for which the rate has been below `held_rate` without a break [s]."""
    settings: GovernorSettings
    """Tuned numbers."""


class GovernorState(NamedTuple):
    """Arrays that the kernels of the reference governor work on."""

    sensors: Records[ActuatorReadings]  # [n], measured
    modes: ModeArray  # [n] prepared modes of the servo
    scheduled: ModeArray  # [n] modes that the plan has at present, or prepares
    reference: FloatArray  # [points, 3, n] q, q̇, q̈; point 0 is now
    speed_scaling: Records[SpeedScaling]  # [1] speed scaling of the reference
    full_speed_velocity: FloatArray  # [n] rad/s, velocity of the reference at full speed
    valve_overlap: FloatArray  # [n, 2] overlaps that the controller compensates, by direction
    cylinders: Records[CylinderConstants]  # [n] cylinders of the circuit as the servo knows it
    constants: Records[CircuitConstants]  # [1] constants of that circuit
    commands: Records[ActuatorState]  # [n] actuators of that circuit, with their valve commands
    linkage: FloatArray  # [n, LINKAGE_WIDTH] parameters of the linkages
    chain: Chain  # links of the arm
    actuators: Records[GovernedActuator]  # [n]
    totals: Records[GovernorTotals]  # [1]


def build_governor_state(
    machine: Machine,
    signals: ServoSignals,
    reference: ReferencePreview,
    usual_error: float,
    settings: GovernorSettings = GovernorSettings(),
) -> GovernorState:
    """Build the state of the reference governor before its first step.

    The governor requests boost and slows the plan if measured pressures come near their limits.

    Args:
        machine: The machine as declared in its file (the real one may differ).
        signals: Signals of the servo controller; their arrays are shared, not copied.
        reference: The reference that is slowed; its speed scaling is shared.
        usual_error: Distance of the tip from its reference that is normal for an arm of the paper's
            size [m]. The governor multiplies the distance by the machine's relative size.
        settings: Tuned numbers.

    Returns:
        The state, with filters that start at the first measurement.
    """
    overall = create_records(GovernorTotals, 1)
    overall["step"] = machine.config.simulation.step
    overall["usual_error"] = machine.relative_size * usual_error
    overall["max_slowing"] = settings.scaling.max_slowing * compute_braking_rate(machine)
    overall["settings"] = create_record(settings)
    return GovernorState(
        sensors=signals.sensors,
        modes=signals.modes,
        scheduled=signals.modes.copy(),
        reference=signals.reference,
        speed_scaling=reference.speed_scaling,
        full_speed_velocity=reference.full_speed_velocity,
        valve_overlap=signals.valve_overlap,
        cylinders=signals.circuit.cylinders,
        constants=signals.circuit.constants,
        commands=signals.circuit.actuators,
        linkage=machine.arrays.linkage,
        chain=get_chain(machine.arrays),
        actuators=create_records(GovernedActuator, machine.joint_count),
        totals=overall,
    )


@kernel(borrows=True)
def run_governor_step(g: GovernorState) -> bool:
    """Run one step of the governor: compute the reserves, request boost, and set the speed scaling.

    The governor slows the plan to a requested rate, 0 … 1. This is the smallest of the rates that
    the tip error, the reserves of supply pressure and the valve openings allow. `usual_error` is
    the normal distance of the tip from its reference. Up to this distance, the tip error allows the
    rate 1. Beyond it, the allowed rate falls linearly to 0 at `hold_error_ratio` times this
    distance. The part of the error by which the tip is ahead of its reference does not count.

    The requested rate is at least `min_rate`. It may be 0 only if the line of a moving actuator has
    less than `min_driving_pressure` beyond its load pressure. `update_rate` then moves the rate
    towards the requested one. The kernel also counts how often and how long the plan is slowed, and
    for how long it has been held until now. The plan is held if its rate is below `min_rate`
    because a line cannot move its actuator.

    Args:
        g: State of the governor. Writes `actuators`, `totals` and `speed_scaling` in place.

    Returns:
        True if a requested mode has changed.
    """
    compute_reserves(g)
    scaling, o, changed = g.speed_scaling[0], g.totals[0], False
    settings = o.settings
    limit, floor = settings.hold_error_ratio, settings.min_rate
    rate = max((limit - o.error_behind / o.usual_error) / (limit - 1.0), 0.0)
    for j in range(len(g.actuators)):
        actuator = g.actuators[j]
        scheduled = BOOSTED_MODES[g.scheduled[j]]
        changed = update_boost_request(actuator, scheduled, o.step, settings) or changed
        command = g.commands[j].valve_command
        overlap = g.valve_overlap[j, 0 if command >= 0.0 else 1]
        opening = max(abs(command) - overlap, 0.0) / (1.0 - overlap)
        actuator.opening += o.step / settings.opening_filter_time * (opening - actuator.opening)
        actuator.allowed_rate = compute_allowed_rate(actuator, BOOSTED_MODES[g.modes[j]], settings)
        rate = min(rate, actuator.allowed_rate)
        if actuator.driving_pressure < settings.min_driving_pressure:
            floor = 0.0
    before = scaling.rate
    rate = min(max(rate, floor), 1.0)
    update_rate(scaling, rate, o.step, o.max_slowing, settings.scaling)
    if scaling.rate < 1.0:
        o.slowed += o.step
        o.slowings += 1.0 if before == 1.0 else 0.0
    is_held = floor == 0.0 and scaling.rate < settings.min_rate
    o.held = o.held + o.step if is_held else 0.0
    return changed


@kernel(borrows=True)
def compute_reserves(g: GovernorState) -> None:
    """Filter the measurements, and compute pressure reserves and the tip error.

    Results for each actuator:

    - `reserve_in_n`: the available pressure in mode N, minus the greater of the pressures that the
      actuator needs at present and shortly ahead (`_compute_needed_pressures`). The available
      pressure is the lowest line pressure of all actuators in mode N, filtered; without any, its
      last value. While it falls, it is extrapolated by `prediction_time`, but not for
      `driving_pressure`.
    - `reserve`: in mode N equal to `reserve_in_n`. In DB and SB it is the actuator's own line
      pressure minus the pressure needed at present, filtered with `boosted_smoothing`.
    - `driving_pressure`: the available pressure (in DB and SB the line pressure) minus the load
      pressure of the present motion; inf if the actuator does not move.

    Args:
        g: State of the governor. Writes `actuators` (reserves [Pa], deviations [rad or m]) and
            `totals` (supply pressure [Pa], tip errors [m]) in place.
    """
    c, o = g.constants[0], g.totals[0]
    settings, supply = o.settings, math.inf
    alpha = settings.filter_gain
    for j in range(len(g.actuators)):
        if not BOOSTED_MODES[g.modes[j]]:
            supply = min(supply, g.sensors[j].line_pressure)
    if o.is_initialized == 0.0:
        o.supply = min(supply, c.supply_pressure)
    if supply < math.inf:
        o.supply, o.supply_rate = update_alpha_beta_filter(
            o.supply, o.supply_rate, supply, o.step, alpha
        )
    for j in range(len(g.actuators)):
        actuator, sensor, cylinder = g.actuators[j], g.sensors[j], g.cylinders[j]
        cap, rod = cylinder.cap_area, cylinder.rod_area
        force = cap * sensor.cap_pressure - rod * sensor.rod_pressure
        if o.is_initialized == 0.0:
            actuator.line, actuator.force = sensor.line_pressure, force
        actuator.line += alpha * (sensor.line_pressure - actuator.line)
        actuator.force += alpha * (force - actuator.force)
        length, arm, _ = evaluate_linkage(g.linkage[j], g.reference[0, 0, j])
        length_error = sensor.length - length
        actuator.deviation = length_error / arm
        needed, needed_ahead, moving_load_pressure = _compute_needed_pressures(
            g, j, arm, length_error
        )
        greatest_need = max(0.0, needed, needed_ahead)
        actuator.reserve_in_n = (
            o.supply + settings.prediction_time * min(o.supply_rate, 0.0) - greatest_need
        )
        if BOOSTED_MODES[g.modes[j]]:
            reserve_change = actuator.line - max(0.0, needed) - actuator.reserve
            actuator.reserve += o.step / settings.boosted_smoothing * reserve_change
            actuator.driving_pressure = actuator.line - moving_load_pressure
        else:
            actuator.reserve = actuator.reserve_in_n
            actuator.driving_pressure = o.supply - moving_load_pressure
    o.error, o.error_behind = compute_tip_errors(
        g.chain, g.reference[0, 0], g.full_speed_velocity, g.actuators
    )
    o.is_initialized = 1.0


@kernel(borrows=True, forceinline=True)
def _compute_needed_pressures(
    g: GovernorState, j: int, arm: float, length_error: float
) -> tuple[float, float, float]:
    """Compute the supply pressures that an actuator needs at present and shortly ahead.

    The needed pressure is the load pressure plus the drop over the fully open valve. It is computed
    for two speeds of the reference: the present one, as if the plan were not slowed, and one
    shortly ahead (START_PREVIEW_POINT). It is 0 for a present speed up to MOVING_SPEED, and for a
    speed ahead up to STARTING_SPEED, since the closed valve then holds the load. At an end stop,
    which carries the load, it is 0 as well.

    If an actuator has yielded to its load and the tip error is above `lift_error_ratio` times
    `usual_error`, the actuator must lift the load back. It then needs at least the holding pressure
    plus `lifting_pressure` at present. A slew carries no weight and is excepted.

    Args:
        g: State of the governor. The filtered force of the actuator must be that of this step.
        j: Index of the actuator.
        arm: Moment arm at the reference, the piston's speed over the joint's [m/rad; 1 for a
            telescope].
        length_error: Measured cylinder length minus that of the reference [m].

    Returns:
        Pressure needed at present, pressure needed shortly ahead, and load pressure of the present
        motion [Pa]. The last is -inf if the actuator does not move, or is at an end stop.
    """
    cylinder, o, tank = g.cylinders[j], g.totals[0], g.constants[0].tank_pressure
    force = g.actuators[j].force
    cap, rod, k = cylinder.cap_area, cylinder.rod_area, cylinder.valve_coefficient
    needed, needed_ahead, moving_load_pressure = 0.0, 0.0, -math.inf
    if not cylinder.min_length < g.sensors[j].length < cylinder.max_length:
        return needed, needed_ahead, moving_load_pressure
    speed, ahead = arm * g.full_speed_velocity[j], arm * g.reference[START_PREVIEW_POINT, 1, j]
    if abs(speed) > MOVING_SPEED:
        needed = compute_pressure_without_margin(k, cap, rod, tank, force, speed)
        moving_load_pressure = load_pressure(cap, rod, tank, force, speed)
    if abs(ahead) > STARTING_SPEED:
        needed_ahead = compute_pressure_without_margin(k, cap, rod, tank, force, ahead)
    lifts = not (g.chain.slews and j == 0) and length_error * force < 0.0
    if lifts and o.error > o.settings.lift_error_ratio * o.usual_error:
        held = compute_pressure_without_margin(k, cap, rod, tank, force, 0.0)
        needed = max(needed, held + o.settings.lifting_pressure)
    return needed, needed_ahead, moving_load_pressure


@kernel
def update_alpha_beta_filter(
    value: float, rate: float, measured: float, step: float, alpha: float
) -> tuple[float, float]:
    """Advance an α-β filter by one step: smooth a measured value, and estimate its rate.

        r  = measured − (x + h ẋ)
        x' = x + h ẋ + α r,    ẋ' = ẋ + (β/h) r,    β = α²/(2 − α)

    Args:
        value: Filtered value x before the step.
        rate: Its rate of change ẋ before the step [unit of the value per second].
        measured: New measurement.
        step: Time h since the last measurement, above 0 [s].
        alpha: Gain α, above 0 and at most 1.

    Returns:
        New value x' and new rate ẋ'.

    Source:
        T. R. Benedict, G. W. Bordner, IRE Trans. Automatic Control AC-7, 1962 (choice of β).
    """
    away = measured - value - step * rate
    beta = alpha * alpha / (2.0 - alpha)
    return value + step * rate + alpha * away, rate + beta / step * away


@kernel
def update_boost_request(
    actuator: GovernedActuator, scheduled: bool, step: float, settings: GovernorSettings
) -> bool:
    """Request boost for an actuator, or end the request, depending on its reserve in mode N.

    The reserve is `actuator.reserve_in_n`. If the plan does not boost the actuator:

    - Boost (mode DB) is requested once the reserve has been below `boost_below` for `boost_after`.
    - The request ends (mode N) once the reserve has been above `release_above` for `release_after`.

    If the plan boosts the actuator, both thresholds are `keep_below`. A request then ends as soon
    as the reserve is above this threshold.

    Args:
        actuator: State of the governor for one actuator. Writes `requested_mode` and
            `condition_time` [s] in place.
        scheduled: Whether the plan boosts this actuator at present, or prepares to.
        step: Control period [s].
        settings: Tuned numbers.

    Returns:
        True if the requested mode has changed.
    """
    s = settings
    boosts, reserve = actuator.requested_mode != Mode.N, actuator.reserve_in_n
    if boosts:
        due = reserve > (s.keep_below if scheduled else s.release_above)
        after = 0.0 if scheduled else s.release_after
    else:
        due = reserve < (s.keep_below if scheduled else s.boost_below)
        after = s.boost_after
    actuator.condition_time = actuator.condition_time + step if due else 0.0
    if not due or actuator.condition_time < after:
        return False
    actuator.condition_time = 0.0
    actuator.requested_mode = Mode.N if boosts else Mode.DB
    return True


@kernel
def compute_allowed_rate(
    actuator: GovernedActuator, boosted: bool, settings: GovernorSettings
) -> float:
    """Compute the rate of the plan that an actuator's reserve and valve opening allow.

    The pressure reserve allows the rate 1 above `full_rate_reserve` and 0 below
    `zero_rate_reserve`. For a boosted actuator these thresholds are `boosted_full_reserve` and
    `boosted_zero_reserve`. The filtered valve opening allows the rate 1 below `full_rate_opening`
    and 0 above `zero_rate_opening`. Between two thresholds the rate is linear.

    Args:
        actuator: State of the governor for one actuator. Reads `reserve` [Pa] and `opening`.
        boosted: Whether the actuator is in a boosted mode, DB or SB.
        settings: Tuned numbers.

    Returns:
        The smaller of both rates, 0 (standstill) … 1 (full speed).
    """
    s = settings
    full = s.boosted_full_reserve if boosted else s.full_rate_reserve
    none = s.boosted_zero_reserve if boosted else s.zero_rate_reserve
    pressure = (actuator.reserve - none) / (full - none)
    opening = (s.zero_rate_opening - actuator.opening) / (s.zero_rate_opening - s.full_rate_opening)
    return min(max(min(pressure, opening), 0.0), 1.0)


@kernel(borrows=True)
def compute_tip_errors(
    c: Chain, q: FloatArray, speed: FloatArray, actuators: Records[GovernedActuator]
) -> tuple[float, float]:
    """Compute the distance of the tip from its reference, and the part that slowing can reduce.

    The total distance is |J Δq|, to first order in the deviations Δq of the joints, with the
    Jacobian J of the tip. If joint 1 slews, the total includes the direction across the arm's
    plane. If J Δq has a component in the direction of the reference's velocity, the tip is ahead by
    this component. The second distance leaves this component out, since slowing the plan would not
    reduce it.

    Args:
        c: Links of the arm.
        q: Joint positions of the reference, float64[n], [rad or m].
        speed: Joint velocities of the reference at full speed, float64[n], [rad/s or m/s].
        actuators: GovernedActuator[n]. Reads `deviation` (Δq) [rad or m].

    Returns:
        Total distance, and distance without the component ahead [m]. Both are equal if the tip is
        not ahead.
    """
    angle = deviation = turning = x = z = along = across = 0.0
    distance = c.slew_offset  # from the slew's axis
    for j in range(len(q)):
        angle += get_turn_angle(c.turns, q, j)
        cosine, sine = math.cos(angle), math.sin(angle)
        if c.slides[j]:
            x += actuators[j].deviation * cosine
            z += actuators[j].deviation * sine
            along += speed[j] * cosine
            across += speed[j] * sine
        elif c.turns[j]:
            deviation += actuators[j].deviation
            turning += speed[j]
        reach = add_extension(c.slides, c.length, q, j)
        distance += reach * cosine
        right, up = -reach * sine, reach * cosine
        x += right * deviation
        z += up * deviation
        along += right * turning
        across += up * turning
    error, fast, ahead = math.hypot(x, z), math.hypot(along, across), x * along + z * across
    if c.slews:
        y, aside = distance * actuators[0].deviation, distance * speed[0]
        error, fast, ahead = math.hypot(error, y), math.hypot(fast, aside), ahead + y * aside
    if ahead <= 0.0:
        return error, error
    ahead /= fast
    return error, math.sqrt(max(0.0, error * error - ahead * ahead))
