"""The cascade that all controllers share: position → cylinder force → piston speed demand.

In cylinder coordinates, with error e = L_ref − L and F = p_A A − p_B a (positive in extension):

    F_ff  = (M q̈ + C q̇ + g)/r + friction(v_ref) + d     feed-forward
    F_ref = F_ff + (k_p k_h/ω_F) e                         position loop
    u     = v_ref + w + ω_F (F_ref − F)/k_h                force loop, limited at rest
    ẇ     = k_i e                                          for flows that are not in the model

u is the piston speed that the valve's flows are to amount to, k_h = β (A²/V_A + a²/V_B) the
oil's stiffness [N/m], so that dF/dt = k_h (u − v). d takes unknown forces over in the time τ,
hence the force loop damps oscillations without yielding to a load that is not in the model.
Payload and friction are the file's, or learnt (`servo/load_estimate`); what feed-forward then says
anew is taken out of d, so that nothing jumps.

A joint that swings on its oil at ω obeys, with everything else ideal,

    τ s⁴ + (1 + ω_F τ) s³ + ω² τ s² + ω² (1 + k_p τ) s + ω² k_p = 0,

without w, which is stable, for ω_F τ well above 1, where ω² (1 + k_p τ) > ω_F k_p: slow swings
bear neither fast gains nor a fast bias, and where k_p < ω_F. So k_p and ω_F go by each joint's own
lowest ω, τ ≥ 3 ω_F/ω² and k_p ≤ ⅔ ω_F; k_i is a small share of k_p².
Source: M. Jelali, A. Kroll, Hydraulic Servo-systems (cascade and force feedback).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mhsb_model.hydraulics import oil_of, pressure_against, spared_margin
from mhsb_model.kernels.kernel import kernel
from mhsb_model.kinematics import extended
from mhsb_model.linkages.linkage import motion
from mhsb_model.machine import Machine
from mhsb_model.modes import ON_RAIL
from mhsb_model.schema import CascadeGains
from mhsb_model.statics import (
    INERTIA_WORK,
    MOTION_WORK,
    Chain,
    chain_of,
    moving_torques,
    with_payload,
)
from mhsb_model.types import FloatArray, IntArray, ModeArray
from mhsb_sim.circuit.elements import chamber_volumes, friction_force
from mhsb_sim.records import Record, Records
from mhsb_sim.servo.controller import ServoSignals
from mhsb_sim.servo.load_estimate import MOST_INERTIA, Load, load_of, weigh
from mhsb_sim.servo.load_estimate import SLOWEST as STEADY
from mhsb_sim.servo.natural_frequency import lowest_joint_frequencies
from mhsb_sim.servo.reference import AHEAD

GAINS = np.dtype(
    [
        (name, "f8")
        for name in (
            "step",  # s
            "valve_lag",  # s, by which a spool follows its command
            "supply_margin",  # Pa, the plan's and the servo's own
            "spared",  # Pa, the part of it that inertia may use up
            "max_boost_pressure",  # Pa
        )
    ]
)

SCRATCH = MOTION_WORK + 2
"""Rows of working memory: that of the dynamics, torque and weight."""

COSINES, SINES = INERTIA_WORK, INERTIA_WORK + 1
"""The rows of it in which the dynamics leave the cosines and sines of the links' angles."""

BIAS_RESERVE = 3.0
"""τ ω²/ω_F, at least: with 1 the slowest swing would be at the limit of stability."""

POSITION_SHARE = 2.0 / 3.0
"""k_p/ω_F, at most: with 1 the fastest swing would be at the limit of stability."""

REST_SPEED = 0.02
"""u is at most this of a joint whose reference rests [rad/s], so that an arm which has sagged comes
back below 0.05 rad/s when it is healed. Nearly closed, a valve holds by the oil's stiffness. Here
and below what counts as a radian of a joint that slides is `Machine.radians`."""

REST_BAND, REST_SWING = 1e-4, 1e-3
"""Errors of a joint [rad] between which its integral acts while the reference rests: below, it is
not worth the valve's wear, above, it is a swing or a sag that the force loop brings back."""

MOST_INTEGRAL = 6.0
"""w is at most V_max over this."""

AXIS = np.dtype(
    [
        ("position_gain", "f8"),  # 1/s, k_p
        ("force_bandwidth", "f8"),  # rad/s, ω_F
        ("fastest_force", "f8"),  # rad/s, ω_F of a servo whose commands act at once
        ("fastest_position", "f8"),  # 1/s, its k_p
        ("bias_time", "f8"),  # s, in which d follows
        ("length", "f8"),  # m, of the cylinder in the reference now
        ("radian", "f8"),  # rad or m, what counts as one of its joint
        ("arm", "f8"),  # m, moment arm there
        ("speed", "f8"),  # m/s, of its piston
        ("fastest", "f8"),  # m/s, largest |u|
        ("force", "f8"),  # N, feed-forward now
        ("hold", "f8"),  # N, what a closed valve would have to carry now
        ("speed_ahead", "f8"),  # m/s, in the reference ahead
        ("force_ahead", "f8"),  # N
        ("hold_ahead", "f8"),  # N
        ("arm_ahead", "f8"),  # m, moment arm
        ("arm_slope_ahead", "f8"),  # m/rad, its derivative
        ("bias", "f8"),  # N, d; NaN until the first step takes it over
        ("integral_gain", "f8"),  # 1/s², k_i
        ("integral", "f8"),  # m/s, w
        ("largest_integral", "f8"),  # m/s, of w
        ("friction", "f8"),  # N, by the machine file
        ("friction_share", "f8"),  # of it, that feed-forward reckons with
        ("bound", "f8"),  # 1 where the valve cannot do what is demanded
        ("stiffness", "f8"),  # N/m, k_h
        ("cap_stiffness", "f8"),  # Pa/m³, β/V_A
        ("rod_stiffness", "f8"),  # Pa/m³, β/V_B
        ("deliverable", "f8"),  # m/s, largest |u| that its pumps keep up with
        ("demand", "f8"),  # m/s, u
        ("supply_target", "f8"),  # Pa, line pressure to be kept up in boost
        ("target_ahead", "f8"),  # Pa, likewise when the reference ahead is reached
        ("leakage", "f8"),  # m³/s, of the valve by the machine file
        ("line_flow", "f8"),  # m³/s, what the line is about to give
        ("joined", "f8"),  # 1 where the line has been joined to the rail
    ]
)


class Servo(NamedTuple):
    """What every controller works on, as its kernels take it.

    Those are inlined: handing it over costs as much as some of them do.
    """

    reference: FloatArray  # as in ServoSignals, likewise the five below
    sensors: Records
    rail_pressure: FloatArray
    modes: ModeArray
    modes_ahead: ModeArray
    serves: IntArray
    cylinders: Records  # of the circuit, likewise the four below
    constants: Records
    module_home: IntArray
    actuators: Records
    modules: Records
    linkage: FloatArray  # [n, LINKAGE_WIDTH]
    chain: Chain  # links and payload as the machine file has them
    load: Load  # what is known of payload and friction
    gains: Records  # GAINS[1]
    axes: Records  # AXIS[n]
    scratch: FloatArray  # [SCRATCH, n]


def gain_record(machine: Machine, supply_margin: float = 0.0) -> Records:
    """What all axes have in common, in SI units, GAINS[1].

    supply_margin: that the controller boosts beyond what the plan does [Pa].
    """
    config, arrays = machine.config, machine.arrays
    gains = np.zeros(1, GAINS)
    gains["step"] = config.simulation.step
    gains["valve_lag"] = config.circuit.valve_damping / (math.pi * config.circuit.valve_frequency)
    gains["supply_margin"] = arrays.boost_margin + supply_margin
    gains["spared"] = spared_margin(oil_of(arrays))
    gains["max_boost_pressure"] = arrays.max_boost_pressure
    return gains


def axis_records(machine: Machine, own: CascadeGains) -> Records:
    """The cascade's quantities at the start, AXIS[n], with each axis's gains.

    `own` are relative to the valve and to each joint's lowest natural frequency ω, so that the
    loop is the same in all: a slow joint has slow gains.
    """
    config = machine.config
    frequency = lowest_joint_frequencies(machine)
    valve = 2.0 * math.pi * config.circuit.valve_frequency
    axes = np.zeros(machine.joint_count, AXIS)
    axes["force_bandwidth"] = np.minimum(
        own.force_bandwidth * valve, 2.0 * own.force_damping * frequency
    )
    axes["position_gain"] = np.minimum(
        own.position_gain * frequency, POSITION_SHARE * axes["force_bandwidth"]
    )
    axes["fastest_force"], axes["fastest_position"] = axes["force_bandwidth"], axes["position_gain"]
    axes["integral_gain"] = own.integral_gain * axes["position_gain"] ** 2
    axes["largest_integral"] = machine.arrays.max_piston_speed / MOST_INTEGRAL
    axes["bias_time"] = np.maximum(
        config.servo.force_bias_time, BIAS_RESERVE * axes["force_bandwidth"] / frequency**2
    )
    axes["radian"] = machine.radians
    axes["bias"] = np.nan
    axes["deliverable"] = np.inf
    axes["friction_share"] = 1.0
    return axes


def servo_of(
    machine: Machine,
    signals: ServoSignals,
    own: CascadeGains,
    supply_margin: float = 0.0,
    *,
    learns: bool = False,
) -> Servo:
    """The servo of a machine at its start; gains as in `axis_records` and `gain_record`.

    learns: whether payload and friction are learnt.
    """
    circuit = signals.circuit
    return Servo(
        reference=signals.reference,
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
        chain=chain_of(machine.arrays),
        load=load_of(machine.arrays.payload, machine.joint_count, learns=learns),
        gains=gain_record(machine, supply_margin),
        axes=axis_records(machine, own),
        scratch=np.zeros((SCRATCH, machine.joint_count)),
    )


@kernel(inline="always")
def piston_demands(s: Servo) -> None:
    """Write the cascade's quantities of all axes, up to the speed demand u, and learn the load."""
    axes, load, cylinders, sensors = s.axes, s.load, s.cylinders, s.sensors
    c, g = s.constants[0], s.gains[0]
    torque, weight = s.scratch[MOTION_WORK], s.scratch[MOTION_WORK + 1]
    payload = load.believed[0]
    reference_forces(s, payload)
    distance, q = 0.0, s.reference[0, 0]
    for j in range(len(axes) - 1, -1, -1):
        axis, cylinder, sensor = axes[j], cylinders[j], sensors[j]
        distance += extended(s.chain.slides, s.chain.length, q, j) * s.scratch[COSINES, j]
        lifted = distance if s.chain.turns[j] else 0.0
        if s.chain.slides[j]:
            lifted = s.scratch[SINES, j]
        load.weight[j] = s.chain.gravity * lifted
        stiffen(axis, cylinder, sensor, c)
        friction = cylinder.friction * friction_force(
            c.coulomb_friction, c.viscous_friction, c.friction_speed, axis.speed
        )
        axis.friction = friction
        known = axis.force + load.believed[1 + j] * friction
        force = sensor.cap_pressure * cylinder.cap_area - sensor.rod_pressure * cylinder.rod_area
        if math.isnan(axis.bias):
            axis.bias = force - known
        if load.covariance[0, 0] > 0.0:
            steady = min(axis.speed_ahead, axis.speed) > STEADY
            steady = steady or max(axis.speed_ahead, axis.speed) < -STEADY
            calm = abs(torque[j] - weight[j]) < MOST_INERTIA * abs(weight[j])
            weighs = steady and calm and axis.bound == 0.0
            weigh(load, j, weighs, axis.arm * (force - known), axis.arm * friction)
        axis.bias += (force - known - axis.bias) * g.step / axis.bias_time
        demand_speed(axis, known, force, axis.length - sensor.length, g)
    for j in range(len(axes)):
        axis = axes[j]
        known_anew = load.weight[j] / axis.arm * (load.believed[0] - payload)
        known_anew += (load.believed[1 + j] - axis.friction_share) * axis.friction
        axis.bias -= known_anew
        axis.friction_share = load.believed[1 + j]


@kernel(inline="always")
def reference_forces(s: Servo, payload: float) -> None:
    """Write what the reference asks of all axes, now and ahead, under that payload [kg].

    A closed valve would have to hold what the posture weighs, or the whole force where that is
    less.
    """
    axes, chain = s.axes, with_payload(s.chain, payload)
    torque, weight = s.scratch[MOTION_WORK], s.scratch[MOTION_WORK + 1]
    for k in (AHEAD, 0):
        q, qd, qdd = s.reference[k, 0], s.reference[k, 1], s.reference[k, 2]
        moving_torques(chain, q, qd, qdd, s.scratch, weight, torque)
        for j in range(len(axes)):
            axis = axes[j]
            length, arm, slope = motion(s.linkage[j], q[j])
            held = weight[j] if abs(weight[j]) < abs(torque[j]) else torque[j]
            if k == AHEAD:
                axis.speed_ahead = arm * qd[j]
                axis.force_ahead = torque[j] / arm
                axis.hold_ahead = held / arm
                axis.arm_ahead, axis.arm_slope_ahead = arm, slope
            else:
                axis.length, axis.arm = length, arm
                axis.speed = arm * qd[j]
                rests = qd[j] == 0.0 and axis.speed_ahead == 0.0
                axis.fastest = REST_SPEED * abs(arm) * axis.radian if rests else math.inf
                axis.force = torque[j] / arm
                axis.hold = held / arm


@kernel(inline="always")
def stiffen(axis: Record, cylinder: Record, sensor: Record, constants: Record) -> None:
    """Write how stiff the oil of a cylinder is where its piston is now."""
    cap, rod = cylinder.cap_area, cylinder.rod_area
    cap_room, rod_room = chamber_volumes(cylinder, sensor.length)
    axis.cap_stiffness = constants.bulk_modulus / cap_room
    axis.rod_stiffness = constants.bulk_modulus / rod_room
    axis.stiffness = cap * cap * axis.cap_stiffness + rod * rod * axis.rod_stiffness


@kernel(inline="always")
def demand_speed(axis: Record, known: float, force: float, error: float, gains: Record) -> None:
    """Write u; known: feed-forward without d, force: measured [N], error: e [m].

    w waits where the valve cannot do what is demanded, and at rest for errors that are its own.
    """
    pull = axis.force_bandwidth / axis.stiffness
    force_reference = known + axis.bias + axis.position_gain / pull * error
    off = abs(error / (axis.arm * axis.radian))
    acts = axis.fastest == math.inf or REST_BAND < off < REST_SWING
    if axis.bound == 0.0 and acts:
        w = axis.integral + axis.integral_gain * error * gains.step
        axis.integral = min(max(w, -axis.largest_integral), axis.largest_integral)
    demand = axis.speed + pull * (force_reference - force) + axis.integral
    most = min(axis.fastest, axis.deliverable)
    axis.demand = min(max(demand, -most), most)


@kernel(borrows=True)
def supply_need(
    hold: float, force: float, speed: float, cylinder: Record, constants: Records, gains: Records
) -> float:
    """Supply pressure [Pa] that an actuator needs in boost: to hold its load and to move it.

    Each p_L + m(v) + margin as in `mhsb_model.hydraulics`; the greater one, within P_S and the
    highest boost pressure. hold: force [N] that the closed valve would have to carry; force [N] and
    speed [m/s] of the motion, inertia included, which may use up its part of the margin as the plan
    has it. What brakes a load on its way down counts in neither: the opening to the tank does that,
    no pump.
    """
    c, g = constants[0], gains[0]
    k, cap, rod = cylinder.valve_coefficient, cylinder.cap_area, cylinder.rod_area
    need = max(
        pressure_against(k, cap, rod, c.tank_pressure, hold, 0.0),
        pressure_against(k, cap, rod, c.tank_pressure, hold, speed),
        pressure_against(k, cap, rod, c.tank_pressure, force, speed) - g.spared,
    )
    return max(c.supply_pressure, min(need + g.supply_margin, g.max_boost_pressure))


@kernel(borrows=True)
def set_targets(axis: Record, cylinder: Record, constants: Records, gains: Records) -> None:
    """Write the supply pressures that an actuator needs from now on, and later at point `AHEAD`.

    A load that is braked on its way down and lifted again at once takes its whole force from the
    pump as soon as it turns: its line is charged for that before.
    """
    d = axis.bias
    now = supply_need(axis.hold + d, axis.force + d, axis.speed, cylinder, constants, gains)
    if axis.speed * axis.speed_ahead < 0.0:
        now = max(now, supply_need(axis.force + d, axis.force + d, 0.0, cylinder, constants, gains))
    axis.target_ahead = supply_need(
        axis.hold_ahead + d, axis.force_ahead + d, axis.speed_ahead, cylinder, constants, gains
    )
    axis.supply_target = max(now, axis.target_ahead)


@kernel(borrows=True)
def joins_rail(j: int, modes: ModeArray, module_home: IntArray, serves: IntArray) -> bool:
    """Whether actuator j draws on the rail: by its mode, or served by a module of another line."""
    draws = ON_RAIL[modes[j]]
    for k in range(len(serves)):
        draws = draws or (serves[k] == j and module_home[k] != j)
    return draws
