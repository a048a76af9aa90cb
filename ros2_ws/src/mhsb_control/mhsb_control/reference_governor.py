"""The reference governor: boosts actuators and slows the plan before the arm sags.

The planned modes and timing assume the machine of the file. The governor uses what is measured. For
each actuator,

    p_L = (F + a p_T)/A extending, (−F + A p_T)/a retracting    load pressure, F = p_A A − p_B a
    r   = p̂ + T ṗ̂ − p_L − m(v)                                  reserve [Pa] in T, at full speed

p̂ is the filtered pressure of its line and ṗ̂ its rate, counted only while it falls. If the reserve
that the main pump leaves in mode N is too small, the actuator is boosted until the reserve has been
large for a while. What boost cannot supply, or not yet, is gained by slowing the plan. The speed
scaling falls with the smallest reserve, with a valve that stays nearly open, and with the tip's
distance from its reference, down to a hold.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from mhsb_control.controller import ActuatorReadings, ServoSignals
from mhsb_control.reference import ReferencePreview
from mhsb_control.speed_scaling import SpeedScaling, update_rate
from mhsb_model.circuit.quantities import ActuatorState, CircuitConstants, CylinderConstants
from mhsb_model.hydraulics import compute_pressure_without_margin
from mhsb_model.kernels.kernel import kernel
from mhsb_model.kinematics import add_extension, get_turn_angle
from mhsb_model.linkages.linkage import evaluate_linkage
from mhsb_model.machine import Machine
from mhsb_model.modes import BOOSTED_MODES, Mode
from mhsb_model.records import Record, Records, create_records
from mhsb_model.statics import Chain, chain_of
from mhsb_model.types import FloatArray, ModeArray

FILTER_GAIN = 0.1
"""α of the α-β filter for measured values, with β = α²/(2 − α): 10 ms at 1 kHz."""

BOOSTED_SMOOTHING = 0.03
"""Time constant for the reserve of a boosted line [s]; its pump covers shorter shortfalls."""

PREDICTION_TIME = 0.04
"""Prediction time T, about what a pump takes to charge a line [s]."""

BOOST_BELOW, BOOST_AFTER = -3e4, 0.01
"""Reserve in mode N [Pa] below which an actuator is boosted.

The reserve has to stay below it for the second value [s].
A plan may use all of P_S, of which the main pump's droop and the check valve take 0.025 MPa."""

KEPT_BELOW = -1.5e5
"""Reserve in mode N [Pa] below which a boost is kept that the plan ends.

A line that needs less beyond P_S loses next to nothing while `BOOST_AFTER` passes. The plan lets
inertia use up its margin, and a measured reserve comes late."""

RELEASE_ABOVE, RELEASE_AFTER = 4.5e5, 0.3
"""Reserve in mode N [Pa] above which a requested boost ends.

The reserve has to stay above it for the second value [s]."""

FULL_RATE_RESERVE, ZERO_RATE_RESERVE = -8e4, -2.0e5
"""Reserves in mode N [Pa]: full speed above the first, standstill below the second.

The speed is linear in between."""

BOOSTED_FULL_ABOVE, BOOSTED_HOLD_BELOW = -0.5e5, -2.5e5
"""Reserves of a boosted line [Pa]: full speed above the first, standstill below the second.

A boosted line is kept at what is needed."""

FULL_RATE_OPENING, ZERO_RATE_OPENING, OPENING_FILTER_TIME = 0.7, 0.9, 0.1
"""Valve openings for full speed (below) and standstill (above), and time constant of their filter.

The speed is linear in between; the time is in [s]. A valve that stays nearly open has no flow left
to catch up with."""

HOLD_ERROR_RATIO = 1.7
"""Distance of the tip from its reference at which the plan stands still, in usual errors.

Up to one usual error the plan runs at full speed."""

HELD_RATE = 0.02
"""Rate of the speed scaling below which a plan counts as held."""

LIFT_ERROR_RATIO = 0.9
"""Distance of the tip from its reference beyond which a load counts as sagged, in usual errors.

A sagged load has to be lifted back, even if the reference lowers it."""

LIFTING_PRESSURE = 1e5
"""Pressure beyond the holding pressure that counts as needed for lifting [Pa].

A stalled piston is under the full line pressure.
"""

START_PREVIEW_POINT = 1
"""Index of the reference point that shows whether a motion is about to start."""

MOVING_SPEED, STARTING_SPEED = 1e-5, 1e-3
"""Piston speeds [m/s] above which an actuator counts as moving: at present, and ahead."""


class GovernedActuator(Record):
    """State of the governor for one actuator."""

    line: float
    """Filtered line pressure [Pa]."""
    force: float
    """Filtered cylinder force [N]."""
    deviation: float
    """Deviation of the joint from its reference [rad or m]."""
    opening: float
    """Filtered |valve command|."""
    reserve: float
    """Reserve of the line as it is supplied [Pa]."""
    allowed_rate: float
    """Rate of the speed scaling that this actuator allows, 0 … 1."""
    reserve_in_n: float
    """Reserve that it has, or would have, in mode N [Pa]."""
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
    supply: float
    """Filtered pressure that the main pump leaves at the lines in mode N [Pa]."""
    supply_rate: float
    """Rate of change of `supply` [Pa/s]."""
    error: float
    """Distance of the tip from its reference [m]."""
    error_behind: float
    """That distance without the part by which the tip is ahead [m]."""
    is_initialized: float
    """0 until the filters are initialised, then 1."""
    slowings: float
    """Number of times that the rate began to fall."""
    slowed: float
    """Total time at a reduced rate [s]."""
    held: float
    """Time for which the rate has been below HELD_RATE without a break [s]."""


class GovernorState(NamedTuple):
    """Arrays that the kernels of the reference governor work on."""

    sensors: Records[ActuatorReadings]  # [n], measured
    modes: ModeArray  # [n] prepared modes of the servo
    scheduled: ModeArray  # [n] modes that the plan has at present, or prepares
    reference: FloatArray  # [points, 3, n] q, q̇, q̈; point 0 is now
    speed_scaling: Records[SpeedScaling]  # [1] speed scaling of the reference
    full_speed_velocity: FloatArray  # [n] rad/s, velocity of the reference at full speed
    cylinders: Records[CylinderConstants]  # [n] cylinders of the circuit as the servo knows it
    constants: Records[CircuitConstants]  # [1] constants of that circuit
    commands: Records[ActuatorState]  # [n] actuators of that circuit, with their valve commands
    linkage: FloatArray  # [n, LINKAGE_WIDTH] parameters of the linkages
    chain: Chain  # links of the arm
    actuators: Records[GovernedActuator]  # [n]
    totals: Records[GovernorTotals]  # [1]


def build_governor_state(
    machine: Machine, signals: ServoSignals, reference: ReferencePreview, usual_error: float
) -> GovernorState:
    """Build the state of the reference governor before its first step.

    Args:
        machine: The machine as its file describes it.
        signals: Signals of the servo controller; their arrays are shared.
        reference: The reference that is slowed; its speed scaling is shared.
        usual_error: Normal distance of the tip from its reference, for an arm of the paper's size
            [m]. It is scaled with the size of the machine.

    Returns:
        The state.
    """
    overall = create_records(GovernorTotals, 1)
    overall["step"] = machine.config.simulation.step
    overall["usual_error"] = machine.relative_size * usual_error
    return GovernorState(
        sensors=signals.sensors,
        modes=signals.modes,
        scheduled=signals.modes.copy(),
        reference=signals.reference,
        speed_scaling=reference.speed_scaling,
        full_speed_velocity=reference.full_speed_velocity,
        cylinders=signals.circuit.cylinders,
        constants=signals.circuit.constants,
        commands=signals.circuit.actuators,
        linkage=machine.arrays.linkage,
        chain=chain_of(machine.arrays),
        actuators=create_records(GovernedActuator, machine.joint_count),
        totals=overall,
    )


@kernel(borrows=True)
def run_governor_step(g: GovernorState) -> bool:
    """Run one step of the governor: compute the reserves, request boost, and set the speed scaling.

    The requested rate is the smallest that the tip error, the reserves and the valve openings
    allow. By the tip error it is 1 up to one usual error, and falls linearly to 0 at
    HOLD_ERROR_RATIO usual errors. `update_rate` moves the rate towards it. The kernel also counts
    how often and how long the plan is slowed, and how long it is held.

    Args:
        g: State of the governor. Writes `actuators`, `totals` and `speed_scaling` in place.

    Returns:
        True if the requested modes have changed.
    """
    compute_reserves(g)
    scaling, o, changed = g.speed_scaling[0], g.totals[0], False
    rate = max((HOLD_ERROR_RATIO - o.error_behind / o.usual_error) / (HOLD_ERROR_RATIO - 1.0), 0.0)
    for j in range(len(g.actuators)):
        actuator = g.actuators[j]
        changed = update_boost_request(actuator, BOOSTED_MODES[g.scheduled[j]], o.step) or changed
        actuator.opening += (
            o.step / OPENING_FILTER_TIME * (abs(g.commands[j].valve_command) - actuator.opening)
        )
        actuator.allowed_rate = compute_allowed_rate(actuator, BOOSTED_MODES[g.modes[j]])
        rate = min(rate, actuator.allowed_rate)
    before = scaling.rate
    update_rate(scaling, min(rate, 1.0), o.step)
    if scaling.rate < 1.0:
        o.slowed += o.step
        o.slowings += 1.0 if before == 1.0 else 0.0
    o.held = o.held + o.step if scaling.rate < HELD_RATE else 0.0
    return changed


@kernel(borrows=True)
def compute_reserves(g: GovernorState) -> None:
    """Filter the measurements, and compute the reserves of all actuators and the tip's error.

    The needed pressure is p_L + m(v), the load pressure plus the drop over the fully open valve. It
    is computed for the reference's speed at present and for that at point PREVIEW_POINT. An
    actuator that does not move needs 0, since its closed valve holds the load. A piston at its end
    stop needs 0, too. If the tip error exceeds LIFT_ERROR_RATIO usual errors, an actuator that has
    yielded to its load needs at least the holding pressure plus LIFTING_PRESSURE.

    `reserve_in_n` is the lowest line pressure of the actuators in mode N, filtered and predicted by
    PREDICTION_TIME while it falls, less the greater of both needs. In mode N `reserve` equals
    `reserve_in_n`. In DB and SB `reserve` is the actuator's own line pressure less its present
    need, filtered with BOOSTED_SMOOTHING.

    Args:
        g: State of the governor. Writes `actuators` (reserves [Pa], deviations [rad or m]) and
            `totals` (supply pressure [Pa], tip errors [m]) in place.
    """
    c, o = g.constants[0], g.totals[0]
    supply = math.inf
    for j in range(len(g.actuators)):
        if not BOOSTED_MODES[g.modes[j]]:
            supply = min(supply, g.sensors[j].line_pressure)
    if o.is_initialized == 0.0:
        o.supply = min(supply, c.supply_pressure)
    if supply < math.inf:
        o.supply, o.supply_rate = update_alpha_beta_filter(o.supply, o.supply_rate, supply, o.step)
    for j in range(len(g.actuators)):
        actuator, sensor, cylinder = g.actuators[j], g.sensors[j], g.cylinders[j]
        cap, rod = cylinder.cap_area, cylinder.rod_area
        force = cap * sensor.cap_pressure - rod * sensor.rod_pressure
        if o.is_initialized == 0.0:
            actuator.line, actuator.force = sensor.line_pressure, force
        actuator.line += FILTER_GAIN * (sensor.line_pressure - actuator.line)
        actuator.force += FILTER_GAIN * (force - actuator.force)
        length, arm, _ = evaluate_linkage(g.linkage[j], g.reference[0, 0, j])
        away = sensor.length - length
        actuator.deviation = away / arm
        speed, ahead = arm * g.full_speed_velocity[j], arm * g.reference[START_PREVIEW_POINT, 1, j]
        k, tank, needed, soon = cylinder.valve_coefficient, c.tank_pressure, 0.0, 0.0
        if (
            cylinder.min_length < sensor.length < cylinder.max_length
        ):  # at an end stop, that carries the load
            if abs(speed) > MOVING_SPEED:
                needed = compute_pressure_without_margin(k, cap, rod, tank, actuator.force, speed)
            if abs(ahead) > STARTING_SPEED:
                soon = compute_pressure_without_margin(k, cap, rod, tank, actuator.force, ahead)
            if o.error > LIFT_ERROR_RATIO * o.usual_error and away * actuator.force < 0.0:
                held = compute_pressure_without_margin(k, cap, rod, tank, actuator.force, 0.0)
                needed = max(needed, held + LIFTING_PRESSURE)
        least = max(0.0, needed, soon)
        actuator.reserve_in_n = o.supply + PREDICTION_TIME * min(o.supply_rate, 0.0) - least
        if BOOSTED_MODES[g.modes[j]]:
            lasting = actuator.line - max(0.0, needed) - actuator.reserve
            actuator.reserve += o.step / BOOSTED_SMOOTHING * lasting
        else:
            actuator.reserve = actuator.reserve_in_n
    o.error, o.error_behind = compute_tip_errors(
        g.chain, g.reference[0, 0], g.full_speed_velocity, g.actuators
    )
    o.is_initialized = 1.0


@kernel
def update_alpha_beta_filter(
    value: float, rate: float, measured: float, step: float
) -> tuple[float, float]:
    """Update an α-β filter, which smooths a measured value and estimates its rate, by one step.

        r  = measured − (x + h ẋ)
        x' = x + h ẋ + α r,    ẋ' = ẋ + (β/h) r,    α = FILTER_GAIN,    β = α²/(2 − α)

    Args:
        value: Filtered value x.
        rate: Rate of change ẋ of that value [unit of the value per second].
        measured: New measurement.
        step: Time h since the last measurement, above 0 [s].

    Returns:
        New value x' and new rate ẋ'.

    Source: T. R. Benedict, G. W. Bordner, IRE Trans. Automatic Control AC-7, 1962 (choice of β).
    """
    away = measured - value - step * rate
    beta = FILTER_GAIN * FILTER_GAIN / (2.0 - FILTER_GAIN)
    return value + step * rate + FILTER_GAIN * away, rate + beta / step * away


@kernel
def update_boost_request(actuator: GovernedActuator, scheduled: bool, step: float) -> bool:
    """Request boost for an actuator or end the request, according to its reserve in mode N.

    The reserve in mode N is `actuator.reserve_in_n`. Boost is requested (mode DB) after the reserve
    has been below BOOST_BELOW for BOOST_AFTER. The request ends (mode N) after the reserve has been
    above RELEASE_ABOVE for RELEASE_AFTER. If the plan boosts the actuator itself, the threshold is
    KEPT_BELOW in both directions, and a request ends at once. Pressure that is needed only to start
    a motion is then no reason to keep a boost.

    Args:
        actuator: State of the governor for one actuator. Writes
            `requested_mode` (the requested mode) and `condition_time` [s] in place.
        scheduled: Whether the plan boosts this actuator at present, or prepares to.
        step: Control period [s].

    Returns:
        True if the request has changed.
    """
    boosts, reserve = actuator.requested_mode != Mode.N, actuator.reserve_in_n
    if boosts:
        due = reserve > (KEPT_BELOW if scheduled else RELEASE_ABOVE)
        after = 0.0 if scheduled else RELEASE_AFTER
    else:
        due = reserve < (KEPT_BELOW if scheduled else BOOST_BELOW)
        after = BOOST_AFTER
    actuator.condition_time = actuator.condition_time + step if due else 0.0
    if not due or actuator.condition_time < after:
        return False
    actuator.condition_time = 0.0
    actuator.requested_mode = Mode.N if boosts else Mode.DB
    return True


@kernel
def compute_allowed_rate(actuator: GovernedActuator, boosted: bool) -> float:
    """Compute the rate of the speed scaling that an actuator's reserve and valve opening allow.

    By the reserve, the rate is 1 above FULL_RATE_RESERVE and 0 below ZERO_RATE_RESERVE, linear in
    between. For a boosted actuator these thresholds are BOOSTED_FULL_ABOVE and BOOSTED_HOLD_BELOW.
    By the filtered valve opening, the rate is 1 below FULL_RATE_OPENING and 0 above
    ZERO_RATE_OPENING.

    Args:
        actuator: State of the governor for one actuator. Reads
            `reserve` and `opening`.
        boosted: Whether the actuator is in DB or SB.

    Returns:
        Smaller of both rates, 0 … 1.
    """
    full = BOOSTED_FULL_ABOVE if boosted else FULL_RATE_RESERVE
    none = BOOSTED_HOLD_BELOW if boosted else ZERO_RATE_RESERVE
    pressure = (actuator.reserve - none) / (full - none)
    opening = (ZERO_RATE_OPENING - actuator.opening) / (ZERO_RATE_OPENING - FULL_RATE_OPENING)
    return min(max(min(pressure, opening), 0.0), 1.0)


@kernel(borrows=True)
def compute_tip_errors(
    c: Chain, q: FloatArray, speed: FloatArray, actuators: Records[GovernedActuator]
) -> tuple[float, float]:
    """Compute the distance of the tip from its reference, in total and without the part ahead.

    The first value is |J Δq|, to first order in the deviations Δq of the joints. If joint 1 slews,
    it contains the direction across the arm's plane. The part ahead is that of J Δq along the
    reference's velocity, if the tip is ahead. The second value omits it, since slowing the
    plan would not reduce it.

    Args:
        c: Links of the arm.
        q: Joint positions of the reference, float64[n], [rad or m].
        speed: Joint velocities of the reference at full speed, float64[n], [rad/s or m/s].
        actuators: GovernedActuator[n]. Reads `deviation` (Δq) [rad or m].

    Returns:
        Total distance [m], and distance without the part ahead [m]. Both are equal if the tip is
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
