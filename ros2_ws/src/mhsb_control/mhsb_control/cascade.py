"""The cascade that all controllers share: position loop, force loop, piston speed demand.

The loops work in cylinder coordinates. The position error is e = L_ref − L [m]. The cylinder force
is F = p_A A − p_B a [N], positive in extension.

    F_ff  = (M q̈ + C q̇ + g)/r + friction(v_ref) + d     feedforward
    F_ref = F_ff + (k_p k_h/ω_F) e                         position loop
    u     = v_ff + w + ω_F (F_ref − F)/k_h                 force loop, limited at rest
    v_ff  = v_ref(t + T) + Ḟ_m(t + T)/k_h                  piston and oil, T known
    ẇ     = k_i e                                          integral, for unmodelled flows
    τ ḋ   = F − F_ff                                       force bias, for unmodelled forces

T is the time until a command acts [s], and F_m = (M q̈ + C q̇ + g)/r. A controller that does not
know T has v_ff = v_ref(t). u is the demanded piston speed [m/s]; the valve flows are to produce it.
The stiffness of the oil is k_h = β (A²/V_A + a²/V_B) [N/m], so that dF/dt = k_h (u − v). Ḟ_m/k_h is
the piston speed that compresses the oil as the force of the motion rises. Without this term, only
the force loop would build up the force, and slowly if ω_F is low. The bias d follows unmodelled
forces with the time constant τ. So the force loop damps oscillations, but does not yield to an
unmodelled load.

Payload and friction come from the machine file, or are estimated (`mhsb_control/load_estimate`). If
an estimate changes the feedforward, d changes by the opposite amount, so that F_ff stays
continuous.

A joint oscillates on its oil at ω [rad/s]. With everything else ideal and without w, the loop has
the characteristic equation

    τ s⁴ + (1 + ω_F τ) s³ + ω² τ s² + ω² (1 + k_p τ) s + ω² k_p = 0.

For ω_F τ well above 1 it is stable if ω² (1 + k_p τ) > ω_F k_p and k_p < ω_F. A joint with a low ω
therefore allows neither high gains nor a fast bias. k_p and ω_F are set from the lowest ω of each
joint, with τ ≥ 3 ω_F/ω² and k_p ≤ ⅔ ω_F. k_i is a small share of k_p².

Source: M. Jelali, A. Kroll, Hydraulic Servo-systems (cascade and force feedback).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from mhsb_control.controller import ActuatorReadings, ServoSignals
from mhsb_control.load_estimate import (
    LoadEstimate,
    LoadSettings,
    accumulate_load_window,
    build_load_estimate,
)
from mhsb_control.machine_scales import compute_supply_torques
from mhsb_control.natural_frequency import find_joint_frequency_ranges
from mhsb_control.reference import PREVIEW_POINT
from mhsb_model.circuit.dead_time import compute_valve_lag
from mhsb_model.circuit.elements import compute_chamber_volumes, compute_friction_force
from mhsb_model.circuit.quantities import (
    ActuatorState,
    CircuitConstants,
    CylinderConstants,
    ModuleState,
)
from mhsb_model.hydraulics import (
    compute_inertia_margin,
    compute_pressure_without_margin,
    get_shared_hydraulics,
)
from mhsb_model.kernels.kernel import kernel
from mhsb_model.kinematics import add_extension
from mhsb_model.linkages.linkage import evaluate_linkage
from mhsb_model.machine import Machine
from mhsb_model.modes import RAIL_MODES
from mhsb_model.records import Record, Records, create_record, create_records
from mhsb_model.schema import Gain, NonNegative, Section
from mhsb_model.statics import (
    INERTIA_WORK,
    MOTION_WORK,
    Chain,
    compute_motion_torques,
    get_chain,
    replace_payload,
)
from mhsb_model.types import FloatArray, IntArray, ModeArray


@dataclass(frozen=True)
class CascadeSettings(Record):
    """Tuned numbers of the cascade."""

    min_bias_time_ratio: float = 3.0
    """Smallest τ ω²/ω_F of a joint, 1 … 100.

    Origin: the characteristic equation of the module's text. With 1, the lowest mode of the joint
    would be at the limit of stability; 3 is a margin of 9.5 dB.

    30 % smaller and larger, N = 5: RMS error −13.9 and −0.5 % (mhsb_arm3; overshoot −0.05 and
    +0.10 MPa), +4.4 and −7.3 % (excavator; overshoot −0.20 and −0.57 MPa)."""
    max_position_gain_ratio: float = 2.0 / 3.0
    """Largest k_p/ω_F, above 0 … 1.

    Origin: the characteristic equation of the module's text. With 1, the fastest oscillation would
    be at the limit of stability; ⅔ is a margin of 3.5 dB.

    30 % smaller and larger, N = 5: RMS error −2.1 and −5.6 % (mhsb_arm3; overshoot −0.01 and
    +0.11 MPa), +3.6 and +2.0 % (excavator; overshoot −3.54 and −1.45 MPa)."""
    rest_speed: float = 0.02
    """Largest joint speed that |u| may demand while the joint's reference rests [rad/s], 0.001 … 1.

    An arm that has sagged then returns at less than 0.05 rad/s after its fault is cleared. A nearly
    closed valve holds the load by the stiffness of the oil. For a prismatic joint, here and below,
    `Machine.radian_equivalents` is the travel that counts as one radian. Origin: chosen as a speed
    that does not surprise a person beside the arm.

    30 % smaller and larger, N = 5: RMS error −0.2 and −4.4 % (mhsb_arm3), +0.8 and −0.4 %
    (excavator)."""
    min_rest_error: float = 1e-4
    """Joint error from which the integral acts while the reference rests [rad], 0 … 0.01.

    Smaller errors are not worth the wear of the valve. Origin: one step of a 16-bit encoder.

    30 % smaller and larger, N = 5: RMS error −1.3 and −3.6 % (mhsb_arm3), −2.7 and +1.0 %
    (excavator; overshoot −0.19 and −2.35 MPa)."""
    max_rest_error: float = 1e-3
    """Joint error up to which the integral acts while the reference rests [rad], 1e-4 … 0.1.

    Larger errors come from an oscillation or a sagging load, which the force loop corrects. Origin:
    chosen.

    30 % smaller and larger, N = 5: RMS error +0.1 and 0 % (mhsb_arm3), +0.1 and +0.3 %
    (excavator)."""
    integral_limit_ratio: float = 6.0
    """Ratio of the speed limit V_max to the largest |w|, 1 … 1000.

    Origin: chosen; w replaces an unmodelled flow of at most a sixth of the piston's.

    30 % smaller and larger, N = 5: no effect on mhsb_arm3 and excavator."""
    crossing_lags: float = 1.0
    """Time by which a spool begins to cross its overlap before the command of a motion, in lags of
    the spool, 0 … 5.

    Origin: chosen; a spool with a first-order lag has covered 63 % of its overlap by then.

    30 % smaller and larger: not measured."""
    load: LoadSettings = field(default_factory=LoadSettings)
    """Tuned numbers of the estimates of payload and friction."""


class SharedGains(Record):
    """Quantities that all axes share."""

    step: float
    """Control period [s]."""
    valve_lag: float
    """Lag of a spool behind its command [s]."""
    reaction_time: float
    """Time T from a measurement to its effect on the valve opening [s]."""
    supply_margin: float
    """Boost margin of the plan plus that of the servo [Pa]."""
    inertia_margin: float
    """Part of the margin that inertia forces may use up [Pa]."""
    max_boost_pressure: float
    """Highest pressure that boost may supply [Pa]."""
    settings: CascadeSettings
    """Tuned numbers of the cascade."""


PositionGain = Annotated[
    Gain,
    Field(description="piston speed per position error, in the joint's natural frequencies [-]"),
]
ForceBandwidth = Annotated[
    Gain,
    Field(
        description="of the cylinder force loop, at most, in natural frequencies of the servo "
        "valve [-]"
    ),
]


class CascadeGains(Section):
    """Gains of the cascade, relative to the machine's own frequencies.

    Attributes:
        search_ranges: Range in which `tune` searches each gain, in the unit of the machine file.
            Gains are drawn in this order. The range of the integral gain leaves out 0, which would
            switch the integral off.
    """

    search_ranges: ClassVar[dict[str, tuple[float, float]]] = {
        "position_gain": (0.2, 2.0),
        "integral_gain": (1e-3, 0.1),
        "force_bandwidth": (0.02, 0.5),
        "force_damping": (0.5, 4.0),
    }

    position_gain: PositionGain = 0.9
    integral_gain: NonNegative = Field(
        le=1e4, default=0.0, description="of the position loop, in squares of its gain [-]"
    )
    force_bandwidth: ForceBandwidth = 0.24
    force_damping: Gain = Field(
        default=4.0,
        description="damping ratio that the force loop gives the joint on its oil, at most [-]",
    )


SCRATCH_ROWS = MOTION_WORK + 2
"""Rows of working memory: MOTION_WORK for the dynamics, one of torques, one of gravity torques."""

COSINE_ROW, SINE_ROW = INERTIA_WORK, INERTIA_WORK + 1
"""Rows of the working memory with the cosine and the sine of each link's absolute angle."""


class ControlAxis(Record):
    """State of the control loops of one cylinder.

    "Reference" in the fields means the reference of the joint that this cylinder moves.
    """

    position_gain: float
    """Position gain k_p [1/s]."""
    force_bandwidth: float
    """Bandwidth ω_F of the force loop [rad/s]."""
    max_force_bandwidth: float
    """ω_F if commands acted without delay [rad/s]."""
    max_position_gain: float
    """k_p if commands acted without delay [1/s]."""
    max_integral_gain: float
    """k_i if commands acted without delay [1/s²]."""
    highest_frequency: float
    """Highest natural frequency of the joint on its oil [rad/s]."""
    flow_damping: float
    """Rate κ at which the flow through the valve damps the force at the present opening [1/s]."""
    bias_time: float
    """Time constant τ of the bias d [s]."""
    length: float
    """Length of the cylinder in the present reference [m]."""
    radian_equivalent: float
    """Joint travel that counts as one radian [rad or m]."""
    arm: float
    """Moment arm in the present reference [m]."""
    speed: float
    """Piston speed in the present reference [m/s]."""
    speed_to_command: float
    """Piston speed of the reference at the time when a command sent now acts [m/s]."""
    force_to_command: float
    """Force of the reference when a command sent now acts, without friction [N].

    NaN if commands act at once."""
    force_rate: float
    """Rate of change of `force_to_command` [N/s]; 0 if commands act at once."""
    speed_to_pump: float
    """Piston speed of the reference at the time when a pump command sent now acts [m/s]."""
    force_to_pump: float
    """Force of the reference when a pump command sent now acts, without friction [N]."""
    holding_force_to_pump: float
    """Force that a closed valve would have to carry when a pump command sent now acts [N]."""
    speed_to_cross: float
    """Piston speed of the reference when the spool has crossed its overlap [m/s].

    The spool moves by a command that is sent now."""
    moving_speed: float
    """Piston speed of the reference above which the load is estimated [m/s]."""
    max_speed_at_rest: float
    """Largest |u| at rest [m/s]; inf while the reference moves."""
    force: float
    """Torque of the present reference divided by the moment arm, without friction [N]."""
    speed_ahead: float
    """Piston speed at point PREVIEW_POINT of the reference [m/s]."""
    force_ahead: float
    """Force at point PREVIEW_POINT, without friction [N]."""
    holding_force_ahead: float
    """Force that a closed valve would have to carry at point PREVIEW_POINT [N]."""
    arm_ahead: float
    """Moment arm at point PREVIEW_POINT [m]."""
    arm_slope_ahead: float
    """Derivative of `arm_ahead` by the joint angle [m/rad]."""
    feedforward: float
    """Force of the reference with friction and bias d [N]."""
    bias: float
    """Unmodelled force d [N]; NaN before the first step."""
    integral_gain: float
    """Integral gain k_i [1/s²]."""
    integral: float
    """Integral w [m/s]."""
    integral_limit: float
    """Limit of |w| [m/s]."""
    friction: float
    """Friction at the reference speed, computed from the machine file [N]."""
    friction_share: float
    """Factor on `friction` that the feedforward contained in the last step."""
    is_saturated: float
    """1 if the valve cannot produce the demanded speed, else 0."""
    stiffness: float
    """Stiffness k_h of the oil [N/m]."""
    cap_stiffness: float
    """Stiffness β/V_A of the oil on the cap side [Pa/m³]."""
    rod_stiffness: float
    """Stiffness β/V_B of the oil on the rod side [Pa/m³]."""
    deliverable_speed: float
    """Largest |u| that the servo pumps can supply [m/s]; inf without boost."""
    demand: float
    """Demanded piston speed u [m/s]."""
    supply_target: float
    """Line pressure to be kept in boost when a pump command acts [Pa]."""
    target_ahead: float
    """Line pressure needed at point PREVIEW_POINT [Pa]."""
    leakage: float
    """Leakage of the valve at the line pressure, computed from the machine file [m³/s]."""
    commanded_flow: float
    """Flow that the piston is commanded to take, delayed by the valve's lag [m³/s]."""
    line_flow: float
    """Flow that the line is about to supply [m³/s]; 0 without boost."""
    joined: float
    """1 if the line counts as joined to the rail, else 0."""


class ServoArguments(NamedTuple):
    """Arrays that the kernels of every controller work on.

    Kernels with this argument are inlined, since passing it takes as long as some of them run.
    """

    reference: FloatArray  # [points, 3, n] q, q̇, q̈; point 0 is now
    sensors: Records[ActuatorReadings]  # [n]
    # [3, 3, n] q, q̇, q̈ when a valve opens, has crossed its overlap, and when a pump command acts
    command_reference: FloatArray
    command_times: FloatArray  # [3] s, times from now to these three
    rail_pressure: FloatArray  # [1] Pa, measured
    modes: ModeArray  # [n] prepared modes
    modes_ahead: ModeArray  # [n] modes in force at point PREVIEW_POINT
    serves: IntArray  # [m] actuator that each booster module serves, −1 if idle
    cylinders: Records[CylinderConstants]  # [n] cylinders of the circuit
    constants: Records[
        CircuitConstants
    ]  # [1] constants of the circuit, such as pressures and coefficients
    # [m] actuator to whose line each booster module belongs; negative for a spare
    module_home: IntArray
    actuators: Records[
        ActuatorState
    ]  # [n] valves and join valves of the circuit, with their commands
    modules: Records[ModuleState]  # [m] booster modules of the circuit, with their commands
    linkage: FloatArray  # [n, LINKAGE_WIDTH] parameters of the linkages
    chain: Chain  # links and payload of the machine file
    load: LoadEstimate  # estimates of payload and friction
    gains: Records[SharedGains]  # [1]
    axes: Records[ControlAxis]  # [n]
    scratch: FloatArray  # [SCRATCH_ROWS, n] working memory


def build_gain_record(
    machine: Machine,
    supply_margin: float = 0.0,
    settings: CascadeSettings = CascadeSettings(),
) -> Records[SharedGains]:
    """Build the record of the quantities that all axes of the cascade share.

    These are the control period, the lag of a spool behind its command, the highest boost pressure,
    and two pressure margins. The margins are the boost margin plus `supply_margin`, and the part of
    the boost margin that inertia may use up. The gains of single joints are not in this record.

    Args:
        machine: The machine as declared in its file (the real one may differ).
        supply_margin: Pressure margin of the controller, added to the boost margin of the machine
            file [Pa].
        settings: Tuned numbers, which the record contains as well.

    Returns:
        One record, SharedGains[1].
    """
    config, arrays = machine.config, machine.arrays
    gains = create_records(SharedGains, 1)
    gains["step"] = config.simulation.step
    gains["valve_lag"] = compute_valve_lag(machine)
    gains["supply_margin"] = arrays.boost_margin + supply_margin
    gains["inertia_margin"] = compute_inertia_margin(get_shared_hydraulics(arrays))
    gains["max_boost_pressure"] = arrays.max_boost_pressure
    gains["settings"] = create_record(settings)
    return gains


def build_axis_records(
    machine: Machine, gains: CascadeGains, settings: CascadeSettings = CascadeSettings()
) -> Records[ControlAxis]:
    """Build the initial records of all axes, with gains set from natural frequencies.

    ω_valve is the valve's natural frequency, ω the lowest natural frequency of each joint [rad/s],
    and g the argument `gains`. `servo.force_bias_time` is a value of the machine file [s].

        ω_F = min(g.force_bandwidth ω_valve, 2 g.force_damping ω)
        k_p = min(g.position_gain ω, max_position_gain_ratio ω_F)
        k_i = g.integral_gain k_p²
        τ   = max(servo.force_bias_time, min_bias_time_ratio ω_F/ω²)

    So a joint with a low natural frequency gets low gains. k_p and k_i are the proportional and the
    integral gain of the position loop. ω_F is the bandwidth of the force loop. τ is the time
    constant of the bias d, a slow estimate of the unmodelled force. The integral w of the position
    loop is limited to the largest piston speed divided by `integral_limit_ratio`.

    Args:
        machine: The machine as declared in its file (the real one may differ).
        gains: Gains of the controller, relative to the natural frequencies.
        settings: Tuned numbers.

    Returns:
        One record for each cylinder, [n]. The bias d and `force_to_command` are NaN until the first
        step. `deliverable_speed` is inf, and `friction_share` is 1. All other lengths, speeds and
        forces are 0.
    """
    config = machine.config
    frequency, highest = find_joint_frequency_ranges(machine)
    valve = 2.0 * math.pi * config.circuit.valve_frequency
    axes = create_records(ControlAxis, machine.joint_count)
    axes["force_bandwidth"] = np.minimum(
        gains.force_bandwidth * valve, 2.0 * gains.force_damping * frequency
    )
    axes["position_gain"] = np.minimum(
        gains.position_gain * frequency, settings.max_position_gain_ratio * axes["force_bandwidth"]
    )
    axes["max_force_bandwidth"], axes["max_position_gain"] = (
        axes["force_bandwidth"],
        axes["position_gain"],
    )
    axes["integral_gain"] = gains.integral_gain * axes["position_gain"] ** 2
    axes["max_integral_gain"], axes["highest_frequency"] = axes["integral_gain"], highest
    axes["integral_limit"] = machine.arrays.max_piston_speed / settings.integral_limit_ratio
    axes["bias_time"] = np.maximum(
        config.servo.force_bias_time,
        settings.min_bias_time_ratio * axes["force_bandwidth"] / frequency**2,
    )
    axes["moving_speed"] = settings.load.min_moving_speed * machine.arrays.max_piston_speed
    axes["radian_equivalent"] = machine.radian_equivalents
    axes["bias"] = axes["force_to_command"] = np.nan
    axes["deliverable_speed"] = np.inf
    axes["friction_share"] = 1.0
    return axes


def build_servo_arguments(
    machine: Machine,
    signals: ServoSignals,
    gains: CascadeGains,
    supply_margin: float = 0.0,
    *,
    estimates_load: bool = False,
    settings: CascadeSettings = CascadeSettings(),
) -> ServoArguments:
    """Build the arrays that the kernels of a servo work on, before its first step.

    Arrays of `signals` are shared and not copied, so that the kernels see every change.

    Args:
        machine: The machine as declared in its file (the real one may differ).
        signals: Arrays that the controller reads and writes in each step.
        gains: Gains of the controller, relative to natural frequencies; see `build_axis_records`.
        supply_margin: Pressure margin of the controller, added to the boost margin of the plan
            [Pa].
        estimates_load: Whether payload and friction are estimated from the motion.
        settings: Tuned numbers.

    Returns:
        The arguments of all kernels of the cascade.
    """
    circuit = signals.circuit
    return ServoArguments(
        reference=signals.reference,
        command_reference=signals.command_reference,
        command_times=signals.command_times,
        sensors=signals.sensors,
        rail_pressure=signals.rail_pressure,
        modes=signals.modes,
        modes_ahead=signals.modes_ahead,
        serves=signals.serves,
        cylinders=circuit.cylinders,
        constants=circuit.constants,
        module_home=circuit.module_home,
        actuators=circuit.actuators,
        modules=circuit.modules,
        linkage=machine.arrays.linkage,
        chain=get_chain(machine.arrays),
        load=build_load_estimate(
            machine.arrays.payload,
            compute_supply_torques(machine),
            is_estimated=estimates_load,
            settings=settings.load,
        ),
        gains=build_gain_record(machine, supply_margin, settings),
        axes=build_axis_records(machine, gains, settings),
        scratch=np.zeros((SCRATCH_ROWS, machine.joint_count)),
    )


@kernel(inline="always")
def compute_piston_demands(s: ServoArguments) -> None:
    """Compute the demanded piston speed u of all axes, and update the load estimate.

    For each axis, the forces of the reference, oil stiffness, friction and bias d are computed. d
    is a slow estimate of the unmodelled force: it follows the measured force minus the feedforward,
    with the time constant `bias_time`. In the first control step, d is set so that the feedforward
    with d equals the measured force. `demand_speed` then gives u.

    While a joint moves steadily and its valve is not saturated, its measured force updates the
    estimates of payload and friction. A motion is steady if both of these hold:

    - The reference's piston speed is above `moving_speed` in one direction, both now and at the
      preview point, a fixed time ahead.
    - The inertia torque is below `max_inertia_share` times the torque of the weight.

    If the estimates change, d changes by the opposite force, so that the feedforward does not jump.
    Nothing is estimated if the variance of the payload is 0.

    Args:
        s: Signals, circuit, axes and estimates of the servo. Reads `reference`, `sensors`,
            `cylinders` and `linkage`; writes `axes`, `load` and `scratch` in place.
    """
    axes, load, cylinders, sensors = s.axes, s.load, s.cylinders, s.sensors
    c, g = s.constants[0], s.gains[0]
    settings = g.settings.load
    torque, weight = s.scratch[MOTION_WORK], s.scratch[MOTION_WORK + 1]
    payload = load.estimate[0]
    compute_reference_forces(s, payload)
    distance, q = 0.0, s.reference[0, 0]
    for j in range(len(axes) - 1, -1, -1):
        axis, cylinder, sensor = axes[j], cylinders[j], sensors[j]
        distance += add_extension(s.chain.slides, s.chain.length, q, j) * s.scratch[COSINE_ROW, j]
        lifted = distance if s.chain.turns[j] else 0.0
        if s.chain.slides[j]:
            lifted = s.scratch[SINE_ROW, j]
        load.weight[j] = s.chain.gravity * lifted
        update_oil_stiffness(axis, cylinder, sensor, c)
        friction = cylinder.friction * compute_friction_force(
            c.coulomb_friction, c.viscous_friction, c.friction_speed, axis.speed
        )
        axis.friction = friction
        known = axis.force + load.estimate[1 + j] * friction
        force = sensor.cap_pressure * cylinder.cap_area - sensor.rod_pressure * cylinder.rod_area
        if math.isnan(axis.bias):
            axis.bias = force - known
        if load.covariance[0, 0] > 0.0:
            slowest = axis.moving_speed
            steady = min(axis.speed_ahead, axis.speed) > slowest
            steady = steady or max(axis.speed_ahead, axis.speed) < -slowest
            calm = abs(torque[j] - weight[j]) < settings.max_inertia_share * abs(weight[j])
            weighs = steady and calm and axis.is_saturated == 0.0
            accumulate_load_window(
                load, j, weighs, axis.arm * (force - known), axis.arm * friction, settings
            )
        axis.bias += (force - known - axis.bias) * g.step / axis.bias_time
        demand_speed(axis, known, force, axis.length - sensor.length, g)
    for j in range(len(axes)):
        axis = axes[j]
        known_anew = load.weight[j] / axis.arm * (load.estimate[0] - payload)
        axis.force_to_command += known_anew
        known_anew += (load.estimate[1 + j] - axis.friction_share) * axis.friction
        axis.bias -= known_anew
        axis.friction_share = load.estimate[1 + j]


@kernel(inline="always")
def compute_reference_forces(s: ServoArguments, payload: float) -> None:
    """Compute lengths, piston speeds and forces of the reference, now and ahead.

    The reference is evaluated now, at the preview point (a fixed time ahead), and when a valve
    command or a pump command sent now acts. Each force is the torque of inverse dynamics divided by
    the moment arm, without friction. The holding force is what a closed valve would have to hold:
    the force of gravity, or the whole force if that is smaller in magnitude.

    If commands act at once (`command_times` is 0), the present values are also used for the times
    at which commands act. `force_to_command` and `force_rate` are then not written. `force_rate` is
    the change of `force_to_command` since the last step, per second, and 0 in the first step.
    `max_speed_at_rest` is inf while the reference moves, now or at the preview point. Otherwise it
    is the piston speed at which the joint moves with `rest_speed`.

    Args:
        s: Signals, circuit, axes and estimates of the servo. Reads `reference`,
            `command_reference`, `chain` and `linkage`. Writes fields of `axes` in place:
            speed_to_command, force_to_command, force_rate and speed_to_cross; speed_to_pump,
            force_to_pump and holding_force_to_pump; speed_ahead, force_ahead, holding_force_ahead,
            arm_ahead and arm_slope_ahead; length, arm, speed, max_speed_at_rest and force.
            Overwrites `scratch`; rows MOTION_WORK and MOTION_WORK + 1 then hold the torques and the
            gravity torques of the present reference [N m or N].
        payload: Payload for the dynamics [kg].
    """
    axes, chain = s.axes, replace_payload(s.chain, payload)
    torque, weight = s.scratch[MOTION_WORK], s.scratch[MOTION_WORK + 1]
    rest_speed, to_cross = s.gains[0].settings.rest_speed, s.command_reference[1]
    at_once = s.command_times[2] == 0.0
    for k in range(2 if at_once else 0, 4):
        state = s.reference[0]
        if k == 0:
            state = s.command_reference[0]
        elif k == 1:
            state = s.command_reference[2]
        elif k == 2:
            state = s.reference[PREVIEW_POINT]
        q, qd = state[0], state[1]
        compute_motion_torques(chain, q, qd, state[2], s.scratch, weight, torque)
        for j in range(len(axes)):
            axis = axes[j]
            length, arm, slope = evaluate_linkage(s.linkage[j], q[j])
            speed, force = arm * qd[j], torque[j] / arm
            held = (weight[j] if abs(weight[j]) < abs(torque[j]) else torque[j]) / arm
            if k == 0:
                rise = force - axis.force_to_command
                axis.force_rate = 0.0 if math.isnan(rise) else rise / s.gains[0].step
                axis.speed_to_command, axis.force_to_command = speed, force
                _, arm, _ = evaluate_linkage(s.linkage[j], to_cross[0, j])
                axis.speed_to_cross = arm * to_cross[1, j]
            elif k == 1:
                axis.speed_to_pump, axis.force_to_pump = speed, force
                axis.holding_force_to_pump = held
            elif k == 2:
                axis.speed_ahead, axis.force_ahead, axis.holding_force_ahead = speed, force, held
                axis.arm_ahead, axis.arm_slope_ahead = arm, slope
            else:
                axis.length, axis.arm, axis.speed, axis.force = length, arm, speed, force
                if at_once:
                    axis.speed_to_command = axis.speed_to_pump = axis.speed_to_cross = speed
                    axis.force_to_pump, axis.holding_force_to_pump = force, held
                rests = speed == 0.0 and axis.speed_ahead == 0.0
                axis.max_speed_at_rest = (
                    rest_speed * abs(arm) * axis.radian_equivalent if rests else math.inf
                )


@kernel(inline="always")
def update_oil_stiffness(
    axis: ControlAxis,
    cylinder: CylinderConstants,
    sensor: ActuatorReadings,
    constants: CircuitConstants,
) -> None:
    """Compute the stiffness of the oil in a cylinder at the measured length.

    The chambers have the piston areas A (cap side) and a (rod side), and the volumes V_A and V_B,
    dead volumes included:

        k_h = β (A²/V_A + a²/V_B)

    Args:
        axis: State of the cylinder's control axis. Writes `cap_stiffness` (β/V_A) and
            `rod_stiffness` (β/V_B) [Pa/m³], and `stiffness` (k_h) [N/m] in place.
        cylinder: Areas, dead volumes and stroke limits of the cylinder.
        sensor: Measured length [m] and pressures [Pa] of the actuator.
        constants: Constants of the circuit with the bulk modulus β [Pa].
    """
    cap, rod = cylinder.cap_area, cylinder.rod_area
    cap_room, rod_room = compute_chamber_volumes(cylinder, sensor.length)
    axis.cap_stiffness = constants.bulk_modulus / cap_room
    axis.rod_stiffness = constants.bulk_modulus / rod_room
    axis.stiffness = cap * cap * axis.cap_stiffness + rod * rod * axis.rod_stiffness


@kernel(inline="always")
def demand_speed(
    axis: ControlAxis, known: float, force: float, error: float, gains: SharedGains
) -> None:
    """Compute the demanded piston speed u of one axis by the position and the force loop.

        u = v_ref(t + T) + Ḟ_m(t + T)/k_h + w + ω_F (F_ref − F)/k_h
        F_ref = F_known + d + (k_p k_h/ω_F) e

    d is the bias, a slow estimate of the unmodelled force. F_m is the force of the reference
    without friction. The term with its rate Ḟ_m is the flow that compresses the oil (`force_rate`;
    0 if commands act at once). ω_F is the bandwidth of the force loop [1/s], and k_h the stiffness
    of the oil [N/m]. k_p is the gain of the position loop [1/s], and T the time until a command
    acts [s]. The magnitude of u is limited to `deliverable_speed`, which the pumps can supply.
    While the reference rests, it is also limited to `max_speed_at_rest`. The integral w is limited
    to ± `integral_limit`, and stays constant while the valve is saturated (anti-windup). While the
    reference rests, w changes only if the joint error is between `min_rest_error` and
    `max_rest_error`.

    Args:
        axis: State of the cylinder's control axis. Writes `feedforward` (F_known + d), `integral`
            (w) and `demand` (u) in place.
        known: F_known, feedforward force without the bias d [N].
        force: F, measured cylinder force [N].
        error: e, reference length minus measured length [m].
        gains: Quantities that all axes share, with the control period.
    """
    pull = axis.force_bandwidth / axis.stiffness
    axis.feedforward = known + axis.bias
    force_reference = axis.feedforward + axis.position_gain / pull * error
    off = abs(error / (axis.arm * axis.radian_equivalent))
    own = gains.settings
    acts = axis.max_speed_at_rest == math.inf or own.min_rest_error < off < own.max_rest_error
    if axis.is_saturated == 0.0 and acts:
        w = axis.integral + axis.integral_gain * error * gains.step
        axis.integral = min(max(w, -axis.integral_limit), axis.integral_limit)
    demand = axis.speed_to_command + axis.force_rate / axis.stiffness
    demand += pull * (force_reference - force) + axis.integral
    most = min(axis.max_speed_at_rest, axis.deliverable_speed)
    axis.demand = min(max(demand, -most), most)


@kernel(borrows=True)
def compute_supply_need(
    hold: float,
    force: float,
    speed: float,
    cylinder: CylinderConstants,
    constants: Records[CircuitConstants],
    gains: Records[SharedGains],
) -> float:
    """Compute the supply pressure that an actuator needs in boost.

    The result is the greatest of three pressures plus the supply margin, limited to the range from
    P_S to the maximum boost pressure. p_L is the load pressure, and m(v) the drop over the fully
    open valve at the speed v. `inertia_margin` is the part of the boost margin that inertia may use
    up. The three pressures are:

        p_L(F_hold)                         holding
        p_L(F_hold) + m(v)                  moving the held load
        p_L(F) + m(v) − inertia_margin      moving it with inertia

    The force that brakes a falling load does not raise the needed pressure, because the valve's
    edge to the tank brakes the load.

    Args:
        hold: F_hold, force that the closed valve would have to carry [N].
        force: F, force of the motion with inertia [N].
        speed: v, piston speed, positive in extension [m/s].
        cylinder: Areas and flow coefficient of the cylinder's valve.
        constants: Constants of the circuit with supply and tank pressure.
        gains: Quantities that all axes share, with margins and the maximum boost pressure [Pa].

    Returns:
        Supply pressure [Pa].
    """
    c, g = constants[0], gains[0]
    k, cap, rod = cylinder.valve_coefficient, cylinder.cap_area, cylinder.rod_area
    need = max(
        compute_pressure_without_margin(k, cap, rod, c.tank_pressure, hold, 0.0),
        compute_pressure_without_margin(k, cap, rod, c.tank_pressure, hold, speed),
        compute_pressure_without_margin(k, cap, rod, c.tank_pressure, force, speed)
        - g.inertia_margin,
    )
    return max(c.supply_pressure, min(need + g.supply_margin, g.max_boost_pressure))


@kernel(borrows=True)
def set_supply_targets(
    axis: ControlAxis,
    cylinder: CylinderConstants,
    constants: Records[CircuitConstants],
    gains: Records[SharedGains],
) -> None:
    """Compute the supply pressures that an actuator needs at two times.

    The first time is when a pump command sent now acts. The second time is the preview point, a
    fixed time ahead. `compute_supply_need` gives both pressures, with the bias d (an estimate of
    the unmodelled force) added to all forces. The first target is at least the second target, so
    that the line is charged in time. If the piston reverses before the preview point, the first
    target is also at least the pressure that holds the whole force at standstill. The pump has to
    carry the whole force when the piston reverses.

    Args:
        axis: State of the cylinder's control axis. Writes `supply_target` and `target_ahead` [Pa]
            in place.
        cylinder: Areas and flow coefficient of the cylinder's valve.
        constants: Constants of the circuit, one record.
        gains: Quantities that all axes share, SharedGains[1].
    """
    d = axis.bias
    held, force = axis.holding_force_to_pump + d, axis.force_to_pump + d
    now = compute_supply_need(held, force, axis.speed_to_pump, cylinder, constants, gains)
    if axis.speed * axis.speed_ahead < 0.0:
        now = max(now, compute_supply_need(force, force, 0.0, cylinder, constants, gains))
    axis.target_ahead = compute_supply_need(
        axis.holding_force_ahead + d,
        axis.force_ahead + d,
        axis.speed_ahead,
        cylinder,
        constants,
        gains,
    )
    axis.supply_target = max(now, axis.target_ahead)


@kernel(borrows=True)
def joins_rail(j: int, modes: ModeArray, module_home: IntArray, serves: IntArray) -> bool:
    """Return whether actuator j draws oil from the shared rail.

    It draws from the rail if its mode is SB. It also draws from the rail if a spare module, or the
    module of another actuator's line, serves it.

    Args:
        j: Index of the actuator.
        modes: Mode of each actuator, uint8[n].
        module_home: Actuator to whose line each module belongs, int64[m]; negative for a spare.
        serves: Actuator that each module serves, int64[m]; −1 if idle.

    Returns:
        True if the actuator's line is to be joined to the rail.
    """
    draws = RAIL_MODES[modes[j]]
    for k in range(len(serves)):
        draws = draws or (serves[k] == j and module_home[k] != j)
    return draws
