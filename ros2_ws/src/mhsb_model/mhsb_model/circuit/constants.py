"""Constants and initial states of the circuit's components, computed from the machine file."""

import math

import numpy as np

from mhsb_model.circuit.elements import compute_spool_transition
from mhsb_model.circuit.quantities import (
    ActuatorState,
    CircuitConstants,
    CylinderConstants,
    ModuleState,
)
from mhsb_model.hydraulics import compute_slip_flow
from mhsb_model.linkages.linkage import cylinder_length
from mhsb_model.machine import Machine
from mhsb_model.records import Records, create_records
from mhsb_model.schema import Motor
from mhsb_model.types import FloatArray, IntArray

RATED_BLEED_PRESSURE = 1e7
"""Pressure drop at which the machine file states the flow of the rail's bleed valve [Pa]."""

FILE_TEMPERATURE = 40.0
"""Oil temperature at which the machine file states the oil's properties [°C]."""

VISCOSITY_SLOPE = 0.036
"""Exponential decrease k_µ of the oil's viscosity with temperature [1/K].

The value fits mineral oil ISO VG 46, whose viscosity falls from 110 mm²/s at 20 °C to 26 mm²/s at
60 °C."""

BULK_MODULUS_SLOPE = 0.005
"""Exponential decrease k_β of a mineral oil's bulk modulus with temperature [1/K]."""


def build_cylinders(machine: Machine) -> Records[CylinderConstants]:
    """Build the records of a machine's cylinders with their servo valves.

    The shortest and the longest cylinder length are the lengths at the two joint limits. A slew may
    be driven by a rotary motor, whose oil volume does not depend on its position. The oil volume of
    a motor is added to the dead volume, and its `swept_volume_factor` is 0.

    Args:
        machine: Machine with n actuators.

    Returns:
        Areas, lengths, dead volume, valve coefficient and friction factor of each cylinder,
        CylinderConstants[n].
    """
    arrays = machine.arrays
    cylinders = create_records(CylinderConstants, machine.joint_count)
    cylinders["cap_area"] = arrays.cap_area
    cylinders["rod_area"] = arrays.rod_area
    for j in range(machine.joint_count):
        ends = [
            cylinder_length(arrays.linkage[j], q)
            for q in (arrays.joint_min[j], arrays.joint_max[j])
        ]
        cylinders["min_length"][j], cylinders["max_length"][j] = min(ends), max(ends)
    motors = [
        joint.linkage if isinstance(joint.linkage, Motor) else None
        for joint in machine.config.joints
    ]
    volume = np.array([motor.volume if motor else 0.0 for motor in motors])
    cylinders["dead_volume"] = machine.config.circuit.chamber_dead_volume + volume
    cylinders["valve_coefficient"] = arrays.valve_coefficient
    cylinders["friction"] = machine.friction_factors
    cylinders["swept_volume_factor"] = [0.0 if motor else 1.0 for motor in motors]
    return cylinders


def build_valve_curves(machine: Machine) -> FloatArray:
    """Build the curves of the valves, as `elements.apply_valve_curve` takes them.

    Args:
        machine: Machine whose file describes the circuit.

    Returns:
        Curve for extension and curve for retraction of the piston, float64[2, 2, k]. Row 0 of each
        curve has the shares of the spool's stroke beyond the overlap, and row 1 the shares of the
        full opening. The shorter curve is filled up with points (1, 1). A straight line has the
        points (0, 0) and (1, 1).
    """
    curves = [curve or ((0.0, 0.0), (1.0, 1.0)) for curve in machine.config.imperfections.curves]
    table = np.ones((2, max(map(len, curves)), 2))
    for own, curve in zip(table, curves, strict=True):
        own[: len(curve)] = curve
    return np.ascontiguousarray(table.transpose(0, 2, 1))


def build_actuators(machine: Machine) -> Records[ActuatorState]:
    """Build the records of a machine's actuators at rest, without faults and with closed valves.

    Args:
        machine: Machine with n actuators.

    Returns:
        ActuatorState[n]. `relief` is the relief pressure of the chambers [Pa]. The shares
        `follows_command` and `leakage` are 1, their value without faults. All other fields are 0.
    """
    actuators = create_records(ActuatorState, machine.joint_count)
    actuators["relief"] = machine.chamber_reliefs
    actuators["follows_command"] = actuators["leakage"] = 1.0
    return actuators


def build_modules(module_home: IntArray) -> Records[ModuleState]:
    """Build the records of booster modules at rest and without faults.

    Args:
        module_home: Index of the actuator whose line each module feeds, int64[m]; −1 for a spare
            module.

    Returns:
        ModuleState[m]. `flow_ratio` and `lag_ratio` are 1. `to_rail` is 1 for spare modules, which
        always feed the rail. All other fields are 0.
    """
    modules = create_records(ModuleState, len(module_home))
    modules["to_rail"] = module_home < 0
    modules["flow_ratio"] = modules["lag_ratio"] = 1.0
    return modules


def compute_viscosity_ratio(temperature: float) -> float:
    """Return the oil's viscosity divided by its viscosity at FILE_TEMPERATURE.

        µ/µ_file = e^(−k_µ ΔT)

    ΔT is the difference of the temperatures, and k_µ is VISCOSITY_SLOPE.

    Args:
        temperature: Temperature of the oil [°C].

    Returns:
        Ratio of the viscosities [-].

    Source:
        H. E. Merritt, Hydraulic Control Systems (viscosity over temperature).
    """
    return math.exp(-VISCOSITY_SLOPE * (temperature - FILE_TEMPERATURE))


def compute_full_pump_flow(machine: Machine) -> float:
    """Return the theoretical flow Q_t of a servo pump at full speed.

        Q_t = Q_SP + Q_reserve + c (p_max − P_S)

    p_max is the highest boost pressure and P_S the main pump's pressure. With this flow, the pump
    delivers its largest flow Q_SP plus the reserve Q_reserve at p_max.

    Args:
        machine: Machine with Q_SP, Q_reserve and slip c of its servo pumps.

    Returns:
        Displacement times full speed [m³/s].
    """
    arrays, reserve = machine.arrays, machine.config.circuit.servo_pump_flow_reserve
    rise = arrays.max_boost_pressure - arrays.supply_pressure
    return arrays.servo_pump_flow + reserve + compute_slip_flow(arrays.servo_pump_slip, 1, rise)


def compute_constants(machine: Machine, substep: float) -> Records[CircuitConstants]:
    """Compute the constants of a machine's circuit.

    Flows at a rated pressure drop become coefficients: Q/√Δp of an orifice, Q/Δp of a linear valve.
    Volumes become capacities V/β, and lags τ become decays e^(−substep/τ).

    The bulk modulus β and the viscosity µ (`compute_viscosity_ratio`) depend on the difference ΔT
    of the oil's temperature from FILE_TEMPERATURE:

        β/β_file = e^(−k_β ΔT)

    k_β is BULK_MODULUS_SLOPE. Viscous friction is proportional to µ. The laminar flows of the
    rail's bleed valve, of the servo valves' lands and of the servo pumps' slip are proportional to
    1/µ. The pressure drop at which an orifice becomes laminar is proportional to µ², since it
    follows from the Reynolds number.

    Components that the machine file leaves out get values that switch them off: bristle stiffness
    0, accumulator volume 0, spool rate inf.

    Args:
        machine: Machine whose file describes the circuit.
        substep: Duration of one integration step of the circuit [s].

    Returns:
        CircuitConstants[1].

    Source:
        H. E. Merritt, Hydraulic Control Systems (bulk modulus over temperature).
    """
    temperature = machine.config.imperfections.oil_temperature
    warmth = temperature - FILE_TEMPERATURE
    beta = machine.config.circuit.bulk_modulus * math.exp(-BULK_MODULUS_SLOPE * warmth)
    thinning = compute_viscosity_ratio(temperature)
    values = {
        "substep": substep,
        **_compute_volume_constants(machine, beta),
        **_compute_pump_constants(machine, thinning, substep),
        **_compute_servo_valve_constants(machine, thinning, substep),
        **_compute_further_valve_constants(machine, thinning, substep),
        **_compute_friction_constants(machine, thinning),
    }
    constants = create_records(CircuitConstants, 1)
    for name, value in values.items():
        constants[name] = value
    return constants


def _compute_volume_constants(machine: Machine, beta: float) -> dict[str, float]:
    """Compute the constants of the oil, its volumes and the accumulator.

    Capacities are volumes divided by the bulk modulus. Without an accumulator, its volume is 0, its
    precharge pressure inf and its exponent 1.

    Args:
        machine: Machine whose file describes the circuit.
        beta: Bulk modulus of the oil at its temperature [Pa].

    Returns:
        Dict from field names of `CircuitConstants` to their values.
    """
    oil, accumulator = machine.config.circuit, machine.config.imperfections.accumulator
    return {
        "tank_pressure": machine.arrays.tank_pressure,
        "vapour_pressure": oil.vapour_pressure,
        "bulk_modulus": beta,
        "free_air": oil.free_air,
        "line_capacity": oil.line_volume / beta,
        "rail_capacity": oil.rail_volume / beta,
        "manifold_capacity": oil.manifold_volume / beta,
        "accumulator_volume": accumulator.volume if accumulator else 0.0,
        "accumulator_precharge": accumulator.precharge if accumulator else math.inf,
        "accumulator_exponent": accumulator.exponent if accumulator else 1.0,
    }


def _compute_pump_constants(
    machine: Machine, viscosity_ratio: float, substep: float
) -> dict[str, float]:
    """Compute the constants of the main pump and of the servo pumps.

    The lags τ of the pumps become decays e^(−dt/τ) over a substep dt. `main_pump_memory` is the
    mean of e^(−t/τ) over the substep. Both are 0 for a main pump without lag. The slip is inversely
    proportional to the viscosity.

    Args:
        machine: Machine whose file describes the circuit.
        viscosity_ratio: Viscosity of the oil divided by that at FILE_TEMPERATURE [-].
        substep: Duration of one integration step of the circuit [s].

    Returns:
        Dict from field names of `CircuitConstants` to their values.
    """
    arrays, oil = machine.arrays, machine.config.circuit
    swing = oil.main_pump_time
    return {
        "supply_pressure": arrays.supply_pressure,
        "main_pump_flow": arrays.main_pump_flow,
        "main_pump_droop": oil.main_pump_droop,
        "main_pump_decay": math.exp(-substep / swing) if swing else 0.0,
        "main_pump_memory": -swing / substep * math.expm1(-substep / swing) if swing else 0.0,
        "main_pump_efficiency": oil.main_pump_efficiency,
        "main_pump_drag": oil.main_pump_drag_power,
        "pump_filling": oil.pump_filling_pressure,
        "servo_pump_drag": oil.servo_pump_drag_power,
        "servo_pump_flow": compute_full_pump_flow(machine),
        "servo_pump_slip": arrays.servo_pump_slip / viscosity_ratio,
        "servo_pump_decay": math.exp(-substep / oil.servo_pump_lag),
        "servo_pump_slew": oil.servo_pump_slew,
        "servo_pump_power": oil.servo_pump_power,
        "servo_pump_efficiency": arrays.servo_pump_efficiency,
    }


def _compute_servo_valve_constants(
    machine: Machine, viscosity_ratio: float, substep: float
) -> dict[str, float]:
    """Compute the constants of the servo valves, their leakage and their lock valves.

    The leakage has two parts: a turbulent flow, and a laminar flow past the lands, inversely
    proportional to the viscosity. Their constants hold for a valve without overlap. The spool is
    described by its transition matrix over a substep.

    Args:
        machine: Machine whose file describes the circuit.
        viscosity_ratio: Viscosity of the oil divided by that at FILE_TEMPERATURE [-].
        substep: Duration of one integration step of the circuit [s].

    Returns:
        Dict from field names of `CircuitConstants` to their values.
    """
    valve, oil, real = (
        machine.config.hydraulics.valve,
        machine.config.circuit,
        machine.config.imperfections,
    )
    drop = machine.arrays.supply_pressure - machine.arrays.tank_pressure
    spool = compute_spool_transition(oil.valve_frequency, oil.valve_damping, substep)
    return {
        "leakage_coefficient": (1.0 - valve.land_leakage) * valve.leakage_flow / math.sqrt(drop),
        "land_conductance": valve.land_leakage * valve.leakage_flow / drop / viscosity_ratio,
        "land_length": oil.land_length,
        "lock_valve_opening": oil.lock_valve_opening,
        "valve_overlap": real.overlaps[0],
        "valve_overlap_retracting": real.overlaps[1],
        "valve_exponent": real.valve_exponent,
        "compensated_drop": valve.largest_drop,
        "valve_hysteresis": real.valve_hysteresis,
        "spool_rate": real.spool_rate or math.inf,
        "spool_00": spool[0],
        "spool_01": spool[1],
        "spool_10": spool[2],
        "spool_11": spool[3],
    }


def _compute_further_valve_constants(
    machine: Machine, viscosity_ratio: float, substep: float
) -> dict[str, float]:
    """Compute the constants of orifices, check, switching, anti-cavitation and relief valves.

    The machine file states the flow Q of a valve at a pressure drop Δp. Check and switching valves
    get the coefficient Q/√Δp, anti-cavitation and bleed valves Q/Δp. The manifold's relief valve
    opens at the main pump's pressure plus a margin.

    Args:
        machine: Machine whose file describes the circuit.
        viscosity_ratio: Viscosity of the oil divided by that at FILE_TEMPERATURE [-].
        substep: Duration of one integration step of the circuit [s].

    Returns:
        Dict from field names of `CircuitConstants` to their values.
    """
    oil = machine.config.circuit
    switching_drop = oil.switching_valve_pressure_drop
    return {
        "laminar_pressure": oil.laminar_pressure * viscosity_ratio**2,
        "check_coefficient": oil.check_valve_flow / math.sqrt(oil.check_valve_pressure_drop),
        "switching_coefficient": oil.switching_valve_flow / math.sqrt(switching_drop),
        "switching_time": oil.switching_valve_time,
        "switching_decay": math.exp(-substep / oil.switching_valve_time),
        "anti_cavitation_gain": oil.anti_cavitation_flow / oil.anti_cavitation_pressure_drop,
        "bleed_conductance": oil.rail_bleed_flow / RATED_BLEED_PRESSURE / viscosity_ratio,
        "relief_gain": oil.relief_flow_gain,
        "line_relief": oil.line_relief_pressure,
        "manifold_relief": machine.arrays.supply_pressure + oil.manifold_relief_margin,
    }


def _compute_friction_constants(machine: Machine, viscosity_ratio: float) -> dict[str, float]:
    """Compute the constants of the cylinders' friction.

    Viscous friction is proportional to the oil's viscosity. Without stiction, stiffness and damping
    of the bristles are 0.

    Args:
        machine: Machine whose file describes the circuit.
        viscosity_ratio: Viscosity of the oil divided by that at FILE_TEMPERATURE [-].

    Returns:
        Dict from field names of `CircuitConstants` to their values.
    """
    oil, stiction = machine.config.circuit, machine.config.imperfections.stiction
    return {
        "coulomb_friction": oil.coulomb_friction,
        "viscous_friction": oil.viscous_friction * viscosity_ratio,
        "friction_speed": oil.friction_speed,
        "breakaway": stiction.breakaway if stiction else 1.0,
        "stribeck_speed": stiction.speed if stiction else 1.0,
        "bristle_stiffness": stiction.stiffness if stiction else 0.0,
        "bristle_damping": stiction.damping if stiction else 0.0,
    }
