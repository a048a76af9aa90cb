"""Constants of the circuit's components, from the machine file."""

from __future__ import annotations

import math

import numpy as np

from mhsb_model.linkages.linkage import cylinder_length
from mhsb_model.machine import Machine
from mhsb_model.schema import Linkage, Motor
from mhsb_model.types import IntArray
from mhsb_sim.circuit.elements import spool_transition
from mhsb_sim.circuit.quantities import ACTUATOR, CONSTANTS, CYLINDER, MODULE
from mhsb_sim.records import Records

RATED_BLEED_PRESSURE = 1e7

FILE_TEMPERATURE = 40.0
"""For which a machine file tells the oil's properties [°C]."""

VISCOSITY_SLOPE = 0.036
"""k_µ of a mineral oil ISO VG 46 between 20 and 60 °C: from 110 to 26 mm²/s [1/K]."""

BULK_MODULUS_SLOPE = 0.005
"""k_β of mineral oils [1/K]."""


def cylinders_of(machine: Machine) -> Records:
    """CYLINDER[n] of a machine, with the valve that each has."""
    arrays = machine.arrays
    cylinders = np.zeros(machine.joint_count, CYLINDER)
    cylinders["cap_area"] = arrays.cap_area
    cylinders["rod_area"] = arrays.rod_area
    for j in range(machine.joint_count):
        ends = [
            cylinder_length(arrays.linkage[j], q)
            for q in (arrays.joint_min[j], arrays.joint_max[j])
        ]
        cylinders[j]["min_length"], cylinders[j]["max_length"] = min(ends), max(ends)
    motors = [linkage if isinstance(linkage, Motor) else None for linkage in _linkages(machine)]
    volume = np.array([motor.volume if motor else 0.0 for motor in motors])
    cylinders["dead_volume"] = machine.config.circuit.chamber_dead_volume + volume
    cylinders["valve_coefficient"] = arrays.valve_coefficient
    cylinders["friction"] = machine.frictions
    cylinders["swept"] = [0.0 if motor else 1.0 for motor in motors]
    return cylinders


def _linkages(machine: Machine) -> list[Linkage]:
    return [joint.linkage for joint in machine.config.joints]


def actuators_of(machine: Machine) -> Records:
    """ACTUATOR[n] at rest and healthy, valves closed."""
    actuators = np.zeros(machine.joint_count, ACTUATOR)
    actuators["relief"] = machine.chamber_reliefs
    actuators["obeys"] = actuators["leakage"] = 1.0
    return actuators


def modules_of(home: IntArray) -> Records:
    """MODULE[m] at rest and healthy; home: int64[m], −1 where a module has no line of its own."""
    modules = np.zeros(len(home), MODULE)
    modules["to_rail"] = home < 0
    modules["strength"] = modules["slowness"] = 1.0
    return modules


def constants_of(machine: Machine, substep: float) -> Records:
    """CONSTANTS[1] of a machine; substep [s].

    Oil that is warmer than the file's is thinner by e^(−k_µ ΔT) and softer by e^(−k_β ΔT).
    Viscosity acts on viscous friction, on laminar leakage and, squared, on the pressure drop at
    which an orifice turns laminar, a matter of its Reynolds number. Source: Merritt (viscosity and
    bulk modulus by temperature).
    """
    arrays = machine.arrays
    oil, real = machine.config.circuit, machine.config.imperfections
    warmth = real.oil_temperature - FILE_TEMPERATURE
    thinner = math.exp(-VISCOSITY_SLOPE * warmth)
    beta = oil.bulk_modulus * math.exp(-BULK_MODULUS_SLOPE * warmth)
    stiction, accumulator = real.stiction, real.accumulator
    spool = spool_transition(oil.valve_frequency, oil.valve_damping, substep)
    values = {
        "tank_pressure": arrays.tank_pressure,
        "supply_pressure": arrays.supply_pressure,
        "main_pump_flow": arrays.main_pump_flow,
        "main_pump_droop": oil.main_pump_droop,
        "bulk_modulus": beta,
        "line_capacity": oil.line_volume / beta,
        "rail_capacity": oil.rail_volume / beta,
        "manifold_capacity": oil.manifold_volume / beta,
        "laminar_pressure": oil.laminar_pressure * thinner**2,
        "leakage_coefficient": arrays.leakage_flow
        / math.sqrt(arrays.supply_pressure - arrays.tank_pressure),
        "check_coefficient": oil.check_valve_flow / math.sqrt(oil.check_valve_pressure_drop),
        "switching_coefficient": oil.switching_valve_flow
        / math.sqrt(oil.switching_valve_pressure_drop),
        "anti_cavitation_gain": oil.anti_cavitation_flow / oil.anti_cavitation_pressure_drop,
        "bleed_conductance": oil.rail_bleed_flow / RATED_BLEED_PRESSURE / thinner,
        "relief_gain": oil.relief_flow_gain,
        "line_relief": oil.line_relief_pressure,
        "manifold_relief": arrays.supply_pressure + oil.manifold_relief_margin,
        "vapour_pressure": oil.vapour_pressure,
        "pump_filling": oil.pump_filling_pressure,
        "main_pump_efficiency": oil.main_pump_efficiency,
        "main_pump_drag": oil.main_pump_drag_power,
        "servo_pump_drag": oil.servo_pump_drag_power,
        "servo_pump_flow": arrays.servo_pump_flow + oil.servo_pump_flow_reserve,
        "servo_pump_decay": math.exp(-substep / oil.servo_pump_lag),
        "servo_pump_slew": oil.servo_pump_slew,
        "servo_pump_power": oil.servo_pump_power,
        "servo_pump_efficiency": arrays.servo_pump_efficiency,
        "switching_time": oil.switching_valve_time,
        "switching_decay": math.exp(-substep / oil.switching_valve_time),
        "coulomb_friction": oil.coulomb_friction,
        "viscous_friction": oil.viscous_friction * thinner,
        "friction_speed": oil.friction_speed,
        "breakaway": stiction.breakaway if stiction else 1.0,
        "stribeck_speed": stiction.speed if stiction else 1.0,
        "bristle_stiffness": stiction.stiffness if stiction else 0.0,
        "bristle_damping": stiction.damping if stiction else 0.0,
        "valve_overlap": real.valve_overlap,
        "valve_hysteresis": real.valve_hysteresis,
        "spool_rate": real.spool_rate or math.inf,
        "accumulator_volume": accumulator.volume if accumulator else 0.0,
        "accumulator_precharge": accumulator.precharge if accumulator else math.inf,
        "accumulator_exponent": accumulator.exponent if accumulator else 1.0,
        "substep": substep,
        "spool_00": spool[0],
        "spool_01": spool[1],
        "spool_10": spool[2],
        "spool_11": spool[3],
    }
    constants = np.zeros(1, CONSTANTS)
    for name, value in values.items():
        constants[name] = value
    return constants
