"""Independent control, as in the paper: valves and servo pumps have separate loops.

The valve opening is proportional to the demanded piston speed, with the valve's gain at a fixed
pressure drop. A PI loop for each pump keeps the pressure of its line, or of the rail, at the value
that the load needs. This loop has no feedforward of the flow that the valves take. Modes switch at
their scheduled times, without preparation.

Source: paper, Sections 2 and 4 (cascade based on pressure feedback).
"""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
from pydantic import Field

from mhsb_control.cascade import (
    CascadeGains,
    ForceBandwidth,
    PositionGain,
    ServoArguments,
    build_servo_arguments,
    compute_piston_demands,
    joins_rail,
    set_supply_targets,
)
from mhsb_control.controller import ServoSignals
from mhsb_model.arm_reports import Estimate
from mhsb_model.hydraulics import inlet_area
from mhsb_model.kernels.bound_kernel import bind_kernel
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.records import Record, Records, create_records
from mhsb_model.schema import Gain, NonNegative, Section
from mhsb_model.types import FloatArray


class IndependentParameters(Record):
    """Gains of the independent controller in SI units."""

    nominal_valve_drop: float
    """Pressure drop over an edge for which the valve's gain is computed [Pa]."""
    pressure_gain: float
    """Proportional gain of the pump's pressure loop [1/s]."""
    pressure_integral_gain: float
    """Integral gain of the pump's pressure loop [1/s²]."""


class IndependentGains(CascadeGains):
    """Gains of the `independent` controller."""

    search_ranges: ClassVar[dict[str, tuple[float, float]]] = {
        **CascadeGains.search_ranges,
        "nominal_valve_drop": (0.03, 1.0),
        "pressure_gain": (10.0, 1000.0),
        "pressure_integral_gain": (10.0, 20000.0),
        "supply_margin": (1e4, 5e5),
    }

    position_gain: PositionGain = 1.22
    force_bandwidth: ForceBandwidth = 0.368
    nominal_valve_drop: Gain = Field(
        default=0.18,
        description="drop over an edge for which the valve's gain is taken, of P_S [-]",
    )
    pressure_gain: float = Field(
        default=157.0, ge=1e-4, le=1e8, description="of the servo pumps' pressure loop [1/s]"
    )
    pressure_integral_gain: NonNegative = Field(
        default=915.0, le=1e12, description="of the servo pumps' pressure loop [1/s²]"
    )
    supply_margin: NonNegative = Field(
        default=1.32e5, le=1e9, description="boosted beyond what the plan needs [Pa]"
    )


class IndependentController:
    """Controller with separate loops for valves and servo pumps, as in the paper."""

    gains_section: type[Section] = IndependentGains
    usual_error = 25e-3

    def __init__(self, machine: Machine, signals: ServoSignals, gains: IndependentGains) -> None:
        """Build the servo's records and bind the control kernel to them.

        The integrals of the pumps' pressure loops begin at 0. `preview` is 0, since this controller
        does not prepare modes in advance.

        Args:
            machine: The machine as declared in its file (the real one may differ).
            signals: Arrays that the controller reads and writes in each step.
            gains: Gains from section `servo.independent` of the machine file.
        """
        self.preview = 0.0
        own_gains = create_records(IndependentParameters, 1)
        own_gains["nominal_valve_drop"] = gains.nominal_valve_drop * machine.arrays.supply_pressure
        own_gains["pressure_gain"] = gains.pressure_gain
        own_gains["pressure_integral_gain"] = gains.pressure_integral_gain
        integrals = np.zeros(len(signals.circuit.modules))
        cascade = build_servo_arguments(machine, signals, gains, gains.supply_margin)
        self._control = bind_kernel(run_independent_step, cascade, own_gains, integrals)

    @property
    def estimates(self) -> list[Estimate]:
        """An empty list, since this controller estimates nothing."""
        return []

    def update(self) -> None:
        """Compute all commands for the next step, and write them into the signals."""
        self._control()


@kernel(borrows=True)
def run_independent_step(
    s: ServoArguments, own_gains: Records[IndependentParameters], integrals: FloatArray
) -> None:
    """Run one step of the independent controller: write the commands of all valves and pumps.

    The valve command is u A_dir/(K √Δp_nominal), limited to −1 … 1. u is the demanded piston speed,
    A_dir the piston area that the supply fills, and K the valve's flow coefficient. A line is
    joined to the rail in mode SB (shared boost). It is also joined if a spare module, or the module
    of another line, serves its actuator. Each pump in use controls the pressure of its line, or of
    the rail if the line is joined:

        Q_cmd = C k_P (p_target − p) + ∫ C k_I (p_target − p) dt,    0 ≤ Q_cmd ≤ Q_max

    p is the measured pressure, and p_target the pressure that the actuator needs. The rail's target
    is the highest target of the joined lines. C is the capacity of the line, or of the rail
    [m³/Pa]. The integral stays constant while the command is at a limit. Command and integral are 0
    for an idle pump. The diverter of a module leads the pump's oil to the rail if the module is
    spare or serves another line.

    Args:
        s: Signals, circuit, axes and estimates of the servo. Writes `axes` and the commands of
            `actuators` and `modules` in place.
        own_gains: Δp_nominal [Pa], k_P [1/s] and k_I [1/s²], IndependentParameters[1].
        integrals: Integral parts of the pumps' pressure loops, float64[m], [m³/s]. Written in
            place.
    """
    sensors, cylinders, axes, actuators = s.sensors, s.cylinders, s.axes, s.actuators
    modes, serves, modules, module_home = s.modes, s.serves, s.modules, s.module_home
    constants, gains, rail_pressure = s.constants, s.gains, s.rail_pressure[0]
    c, own = constants[0], own_gains[0]
    compute_piston_demands(s)
    root = math.sqrt(own.nominal_valve_drop)
    rail_need = 0.0
    for j in range(len(axes)):
        axis, cylinder = axes[j], cylinders[j]
        inlet = inlet_area(cylinder.cap_area, cylinder.rod_area, axis.demand)
        nominal = cylinder.valve_coefficient * root
        actuators[j].valve_command = min(max(axis.demand * inlet / nominal, -1.0), 1.0)
        set_supply_targets(axis, cylinder, constants, gains)
        axis.joined = 1.0 if joins_rail(j, modes, module_home, serves) else 0.0
        actuators[j].join_command = axis.joined
        if axis.joined > 0.0:
            rail_need = max(rail_need, axis.supply_target)
    for k in range(len(modules)):
        module = modules[k]
        user: int = serves[k]
        if user < 0:
            module.flow_command, module.to_rail_command, integrals[k] = 0.0, 0.0, 0.0
            continue
        on_rail = axes[user].joined > 0.0
        module.to_rail_command = 1.0 if module_home[k] != user else 0.0
        error = axes[user].supply_target - sensors[user].line_pressure
        capacity = c.line_capacity
        if on_rail:
            error = rail_need - rail_pressure
            capacity = c.rail_capacity
        command = capacity * own.pressure_gain * error + integrals[k]
        module.flow_command = min(max(command, 0.0), c.servo_pump_flow)
        if command == module.flow_command:
            integrals[k] += capacity * own.pressure_integral_gain * error * gains[0].step
