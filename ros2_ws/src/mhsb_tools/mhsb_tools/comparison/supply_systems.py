"""Energy of a motion with other supplies: constant pressure, load sensing, pump control.

Quasi-steady energy models of the same cylinders on the same motion. All pumps are ideal except for
their efficiency maps. Energy is counted at two boundaries: *hydraulic* is the energy that all pumps
give to the oil, *shaft* the energy at the shafts of the pumps. Load pressure p_L, valve drop m(v),
inlet area A_dir and leakage q(p) of a valve are defined in `mhsb_model.hydraulics`.

A supply that is set beforehand follows the static loads, as plans do, with the machine's boost
margin for inertia and friction. A supply that follows measured pressures sees the whole force F,
including inertia and friction.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from mhsb_model.circuit.elements import friction_force
from mhsb_model.holding import MAX_HELD_SPEED
from mhsb_model.hydraulics import (
    compute_valve_leakage,
    get_shared_hydraulics,
    load_pressure,
    required_pressures,
    valve_margin,
)
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_model.types import FloatArray
from mhsb_planner.motion.energy import motion_energy
from mhsb_planner.motion.motion_profile import motion_profile

LOAD_SENSING_MARGINS = (1e6, 2e6)
"""Pressure margins Δp of load sensing [Pa], the low and the high end of what is usual."""

LEAKAGE_KEY = "hydraulics.valve.leakage_flow"
"""Path of the valves' leakage flow in the machine file."""

_load_pressure = np.vectorize(load_pressure, otypes=[float])
_valve_margin = np.vectorize(valve_margin, otypes=[float])
_friction = np.vectorize(friction_force, otypes=[float])


@dataclass(frozen=True)
class SupplyEnergy:
    """Energy that a motion takes with one supply.

    Attributes:
        hydraulic_j: Energy that all pumps give to the oil [J].
        shaft_j: Energy at the pumps' shafts [J].
    """

    hydraulic_j: float
    shaft_j: float


@dataclass(frozen=True, eq=False)
class MotionLoads:
    """Speeds and forces of the cylinders during a motion, at k instants for n joints.

    Attributes:
        time: Instants, shape (k,) [s].
        speed: Piston speed, positive extending, shape (k, n) [m/s]; 0 within the dead band, if the
            cylinder is held.
        static: Piston force against gravity alone, positive if the load resists extension, shape
            (k, n) [N].
        force: Piston force with inertia and the cylinder's friction, shape (k, n) [N].
    """

    time: FloatArray
    speed: FloatArray
    static: FloatArray
    force: FloatArray

    @property
    def duration(self) -> float:
        """Duration of the motion [s]."""
        return float(self.time[-1] - self.time[0])

    def inflow(self, machine: Machine) -> FloatArray:
        """Compute the flow that valve-controlled cylinders take, Q = Σ A_dir |v|.

        Args:
            machine: The arm, for the areas of cap side (extending) and rod side (retracting).

        Returns:
            Flow at each instant, shape (k,) [m³/s].
        """
        m = machine.arrays
        inlet = np.where(self.speed > 0.0, m.cap_area, m.rod_area)
        return (inlet * np.abs(self.speed)).sum(axis=1)

    def integral(self, power: FloatArray) -> float:
        """Integrate over the motion's time by the trapezoidal rule.

        Args:
            power: Value at each instant, shape (k,), such as power [W].

        Returns:
            ∫ power dt, such as energy [J].
        """
        return float(np.trapezoid(power, self.time))


def loads_of(machine: Machine, trajectory: Trajectory) -> MotionLoads:
    """Compute piston speeds and piston forces during a trajectory.

    They are sampled at the trajectory's points and half-way between.

    Args:
        machine: The arm.
        trajectory: The motion.

    Returns:
        Speeds and forces at these instants.
    """
    points = trajectory.offset_ns
    at = np.union1d(points, (points[1:] + points[:-1]) // 2)
    profile = motion_profile(machine, *trajectory.sample_offsets(at))
    speed = np.where(np.abs(profile.speed) > MAX_HELD_SPEED, profile.speed, 0.0)
    oil = machine.config.circuit
    friction = _friction(oil.coulomb_friction, oil.viscous_friction, oil.friction_speed, speed)
    force = profile.force + profile.inertia + machine.friction_factors * friction
    return MotionLoads(at / SECOND_NS, speed, profile.force, force)


def without_leakage(machine: Machine) -> Machine:
    """Return the machine with valves that do not leak."""
    return machine.with_values({LEAKAGE_KEY: 0.0})


def needed_supply(machine: Machine, loads: MotionLoads) -> float:
    """Return the lowest constant supply pressure with which valves alone do the whole motion.

        p = max over time and joints of p_L + m(v) + margin

    margin is the machine's boost margin. While a cylinder stands still, p_L is the pressure that
    holds its load.

    Args:
        machine: The arm.
        loads: Speeds and static forces of the motion.

    Returns:
        The pressure p [Pa].
    """
    return float(required_pressures(machine.arrays, loads.static, loads.speed).max())


def constant_pressure(machine: Machine, loads: MotionLoads, supply: float) -> SupplyEnergy:
    """Compute the energy with a pressure-controlled pump; valves throttle the rest.

        P = p (Σ A_dir |v| + n q(p))

    Args:
        machine: The arm with n joints.
        loads: Speeds of the motion.
        supply: Constant pressure p [Pa].

    Returns:
        Energy at both boundaries; the pump has the main pump's efficiency map.

    Source:
        H. E. Merritt, Hydraulic Control Systems (constant pressure supply).
    """
    oil, n = get_shared_hydraulics(machine.arrays), machine.joint_count
    power = supply * (loads.inflow(machine) + n * compute_valve_leakage(oil, supply))
    return _from_one_pump(machine, loads, power)


def load_sensing(machine: Machine, loads: MotionLoads, margin: float) -> SupplyEnergy:
    """Compute the energy with one pump that follows the highest load pressure of moving cylinders.

        P = p(t) (Σ A_dir |v| + n q(p))
        p = max(p_T + Δp, max_j p_L,j + max(Δp, m_j))

    Cylinders that stand still signal nothing; their closed valves hold them. The system is ideal:
    no line losses, no drop in compensators, no delay.

    Args:
        machine: The arm with n joints; p_T is its tank pressure.
        loads: Speeds and forces of the motion.
        margin: Pressure margin Δp [Pa].

    Returns:
        Energy at both boundaries; the pump has the main pump's efficiency map.

    Source:
        J. Siebert, M. Wydra, M. Geimer, Energies 2017, 10, 941 (losses of load sensing with
        actuators in parallel); P. Casoli et al., Actuators 2020, 9, 39.
    """
    m, oil = machine.arrays, get_shared_hydraulics(machine.arrays)
    own = _load_pressure(m.cap_area, m.rod_area, oil.tank_pressure, loads.force, loads.speed)
    drop = _valve_margin(m.valve_coefficient, m.cap_area, m.rod_area, loads.speed)
    own = np.where(loads.speed != 0.0, own + np.maximum(margin, drop), -np.inf)
    supply = np.maximum(oil.tank_pressure + margin, own.max(axis=1))
    leaks = machine.joint_count * np.array([compute_valve_leakage(oil, p) for p in supply])
    return _from_one_pump(machine, loads, supply * (loads.inflow(machine) + leaks))


class PumpMap(NamedTuple):
    """Efficiency map of the pumps of all cylinders together: shaft power P/η + P_d.

    Attributes:
        efficiency: Efficiency η [-].
        drag_power: Drag power P_d of all pumps together [W], taken at any load.
    """

    efficiency: float
    drag_power: float


def pump_controlled(
    machine: Machine, loads: MotionLoads, pumps: PumpMap, recovering: bool
) -> SupplyEnergy:
    """Compute the energy with a pump of its own for each cylinder and no valve in between.

        P_j = (F_j − (A − a) p_T) v_j

    The pump lies between the chambers. Pilot-operated check valves keep the chamber with less load
    at tank pressure p_T and take the difference (A − a) v from the reservoir. If F > (A − a) p_T,
    the cap side is loaded, P = (p_A − p_T) A v; else the rod side, P = (p_T − p_B) a v. The shaft
    takes P/η + P_d. If P < 0, a load lowers: the shaft gets back η |P| if `recovering`, else the
    load is braked without energy. Lock valves hold loads; leakage counts only as part of η.

    Args:
        machine: The arm: areas A (cap side) and a (rod side), p_T.
        loads: Speeds v and forces F of the motion.
        pumps: Efficiency η and drag P_d.
        recovering: Whether lowering loads drive their pumps and give energy back.

    Returns:
        Energy at both boundaries.

    Source:
        R. Rahmfeld, M. Ivantysynova, Displacement controlled linear actuator with differential
        cylinder, 5th ICFP 2001; P. Casoli et al., Actuators 2020, 9, 39.
    """
    m = machine.arrays
    power = (loads.force - (m.cap_area - m.rod_area) * m.tank_pressure) * loads.speed
    given, back = np.maximum(0.0, power), np.minimum(0.0, power) * recovering
    hydraulic = (given + back).sum(axis=1)
    shaft = (given / pumps.efficiency + back * pumps.efficiency).sum(axis=1)
    drag = pumps.drag_power * loads.duration
    return SupplyEnergy(loads.integral(hydraulic), loads.integral(shaft) + drag)


def pump_maps(machine: Machine) -> Mapping[str, PumpMap]:
    """Return efficiency maps for pump control, by kind of pump.

    Args:
        machine: The arm.

    Returns:
        `servo pumps`: one pump like the machine's servo pumps for each of n joints. `piston pumps`:
        pumps with the main pump's efficiency that together have its drag.
    """
    oil, n = machine.config.circuit, machine.joint_count
    return {
        "servo pumps": PumpMap(machine.arrays.servo_pump_efficiency, n * oil.servo_pump_drag_power),
        "piston pumps": PumpMap(oil.main_pump_efficiency, oil.main_pump_drag_power),
    }


def compute_mhsb_energy(
    machine: Machine, trajectory: Trajectory, schedule: ModeSchedule
) -> SupplyEnergy:
    """Compute the energy of MHSB as planned: main pump at P_S, servo pumps in series.

    Args:
        machine: The arm.
        trajectory: The motion.
        schedule: Its mode schedule.

    Returns:
        Energy at both boundaries by `motion_energy`; servo pump losses count at the shafts only.
    """
    energy = motion_energy(machine, trajectory, schedule)
    main = add_main_pump_shaft(machine, energy.main_pump, trajectory.duration_ns / SECOND_NS)
    given = energy.servo_pumps - energy.servo_pump_losses
    return SupplyEnergy(main.hydraulic_j + given, main.shaft_j + energy.servo_pumps)


def add_main_pump_shaft(machine: Machine, hydraulic: float, duration: float) -> SupplyEnergy:
    """Convert hydraulic energy to shaft energy by the main pump's efficiency map.

        E_shaft = E/η + P_d T

    Args:
        machine: The arm with the efficiency η and drag power P_d of its main pump.
        hydraulic: Energy E given to the oil [J].
        duration: Time T for which the pump runs [s].

    Returns:
        Both energies; the pump is taken as large as the flow needs.
    """
    oil = machine.config.circuit
    drag = oil.main_pump_drag_power * duration
    return SupplyEnergy(hydraulic, hydraulic / oil.main_pump_efficiency + drag)


def _from_one_pump(machine: Machine, loads: MotionLoads, power: FloatArray) -> SupplyEnergy:
    return add_main_pump_shaft(machine, loads.integral(power), loads.duration)


def constant_needed_pressure(machine: Machine, loads: MotionLoads) -> SupplyEnergy:
    """Compute the energy at the lowest constant pressure that does this very motion."""
    return constant_pressure(machine, loads, needed_supply(machine, loads))


System = Callable[[Machine, MotionLoads], SupplyEnergy]


def baselines(machine: Machine) -> Mapping[str, System]:
    """Return the supply systems with which MHSB is compared, by name.

    Args:
        machine: The arm, for its pump maps.

    Returns:
        Functions by name. Each takes a machine (leaking or `without_leakage`) and a motion's loads,
        and returns the energy. There are constant pressure, load sensing with each of
        `LOAD_SENSING_MARGINS`, and pump control with each of `pump_maps`, with and without
        recovery.
    """
    systems: dict[str, System] = {"constant pressure": constant_needed_pressure}
    for margin in LOAD_SENSING_MARGINS:
        name = f"load sensing, {margin / 1e6:g} MPa"
        systems[name] = partial(load_sensing, margin=margin)
    for kind, pumps in pump_maps(machine).items():
        for ending, recovering in (("", False), (", recovering", True)):
            systems[f"pump control, {kind}{ending}"] = partial(
                pump_controlled, pumps=pumps, recovering=recovering
            )
    return systems
