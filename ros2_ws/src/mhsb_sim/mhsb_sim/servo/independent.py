"""Independent control, as in the paper: valve and servo pumps each have a loop of their own.

The valve turns the demanded piston speed into an opening through its nominal gain, at a fixed
pressure drop. A PI loop per pump keeps its line's or the rail's pressure at what the load needs,
without knowing what the valves take. Modes switch as they are commanded.
Source: paper, Sections 2 and 4 (cascade based on pressure feedback).
"""

from __future__ import annotations

import math

import numpy as np

from mhsb_model.arm_reports import Estimate
from mhsb_model.hydraulics import inlet_area
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray
from mhsb_sim.bound_kernel import bind
from mhsb_sim.records import Records
from mhsb_sim.servo.cascade import Servo, joins_rail, piston_demands, servo_of, set_targets
from mhsb_sim.servo.controller import ServoSignals

GAINS = np.dtype(
    [
        ("nominal_valve_drop", "f8"),  # Pa
        ("pressure_gain", "f8"),  # 1/s
        ("pressure_integral_gain", "f8"),  # 1/s²
    ]
)


class IndependentController:
    """Valve and servo pumps apart; see the module's text."""

    usual_error = 25e-3

    def __init__(self, machine: Machine, signals: ServoSignals) -> None:
        self.preview = 0.0
        servo = machine.config.servo.independent
        own_gains = np.zeros(1, GAINS)
        own_gains["nominal_valve_drop"] = servo.nominal_valve_drop * machine.arrays.supply_pressure
        own_gains["pressure_gain"] = servo.pressure_gain
        own_gains["pressure_integral_gain"] = servo.pressure_integral_gain
        integrals = np.zeros(len(signals.circuit.modules))
        cascade = servo_of(machine, signals, servo, servo.supply_margin)
        self._control = bind(control, cascade, own_gains, integrals)

    @property
    def estimates(self) -> list[Estimate]:
        """It learns nothing."""
        return []

    def update(self) -> None:
        """Write all commands for the next step."""
        self._control()


@kernel(borrows=True)
def control(s: Servo, own_gains: Records, integrals: FloatArray) -> None:
    """One step of the controller.

    own_gains: GAINS[1]; integrals: float64[m], of the pumps' pressure loops [m³/s], held while a
    pump saturates.
    """
    sensors, cylinders, axes, actuators = s.sensors, s.cylinders, s.axes, s.actuators
    modes, serves, modules, module_home = s.modes, s.serves, s.modules, s.module_home
    constants, gains, rail_pressure = s.constants, s.gains, s.rail_pressure[0]
    c, own = constants[0], own_gains[0]
    piston_demands(s)
    root = math.sqrt(own.nominal_valve_drop)
    rail_need = 0.0
    for j in range(len(axes)):
        axis, cylinder = axes[j], cylinders[j]
        inlet = inlet_area(cylinder.cap_area, cylinder.rod_area, axis.demand)
        nominal = cylinder.valve_coefficient * root
        actuators[j].valve_command = min(max(axis.demand * inlet / nominal, -1.0), 1.0)
        set_targets(axis, cylinder, constants, gains)
        axis.joined = 1.0 if joins_rail(j, modes, module_home, serves) else 0.0
        actuators[j].join_command = axis.joined
        if axis.joined > 0.0:
            rail_need = max(rail_need, axis.supply_target)
    for k in range(len(modules)):
        module, user = modules[k], serves[k]
        if user < 0:
            module.flow_command, module.lend, integrals[k] = 0.0, 0.0, 0.0
            continue
        on_rail = axes[user].joined > 0.0
        module.lend = 1.0 if module_home[k] != user else 0.0
        error = axes[user].supply_target - sensors[user].line_pressure
        capacity = c.line_capacity
        if on_rail:
            error = rail_need - rail_pressure
            capacity = c.rail_capacity
        command = capacity * own.pressure_gain * error + integrals[k]
        module.flow_command = min(max(command, 0.0), c.servo_pump_flow)
        if command == module.flow_command:
            integrals[k] += capacity * own.pressure_integral_gain * error * gains[0].step
