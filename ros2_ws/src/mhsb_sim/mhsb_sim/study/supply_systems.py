"""What a motion would take with other supplies: constant pressure, load sensing, pump control.

Quasi-steady energy models of the same cylinders on the same motion, all pumps ideal but for their
efficiency maps. Two boundaries: *hydraulic* is what all pumps give to the oil, *shaft* what turns
them. p_L, m(v) and A_dir are those of `mhsb_model.hydraulics`, q(p) is its leakage of a valve.

The pressures follow the static loads as the plans do, with the machine's boost margin for inertia
and friction, where the supply is set beforehand; where it follows what is measured, F has both.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from mhsb_model.hydraulics import leakage, load_pressure, oil_of, required_pressures, valve_margin
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_model.types import FloatArray
from mhsb_planner.motion.energy import motion_energy
from mhsb_planner.motion.motion_profile import motion_profile
from mhsb_planner.motion.s3_limits import DEAD_BAND
from mhsb_sim.circuit.elements import friction_force

MARGINS = (1e6, 2e6)
"""Δp of load sensing [Pa], the low and the high end of what is usual."""

LEAKAGE_KEY = "hydraulics.valve.leakage_flow"

_load_pressure = np.vectorize(load_pressure, otypes=[float])
_valve_margin = np.vectorize(valve_margin, otypes=[float])
_friction = np.vectorize(friction_force, otypes=[float])


@dataclass(frozen=True)
class Taken:
    """Energy that a motion takes [J]: given to the oil by all pumps, and at their shafts."""

    hydraulic_j: float
    shaft_j: float


@dataclass(frozen=True, eq=False)
class Loads:
    """What a motion asks of the cylinders at k instants, n joints; held ones have speed 0.

    time    float64[k], s
    speed   float64[k, n], m/s of the pistons, positive extending
    static  float64[k, n], N, that gravity alone asks for, positive resists extension
    force   float64[k, n], N, with inertia and the cylinders' friction
    """

    time: FloatArray
    speed: FloatArray
    static: FloatArray
    force: FloatArray

    @property
    def duration(self) -> float:
        """Of the motion [s]."""
        return float(self.time[-1] - self.time[0])

    def inflow(self, machine: Machine) -> FloatArray:
        """Q = Σ A_dir |v| [m³/s] that valve-controlled cylinders take, float64[k]."""
        m = machine.arrays
        inlet = np.where(self.speed > 0.0, m.cap_area, m.rod_area)
        return (inlet * np.abs(self.speed)).sum(axis=1)

    def integral(self, power: FloatArray) -> float:
        """∫ power dt, by trapezoids."""
        return float(np.trapezoid(power, self.time))


def loads_of(machine: Machine, trajectory: Trajectory) -> Loads:
    """At the trajectory's points and half-way between."""
    points = trajectory.offset_ns
    at = np.union1d(points, (points[1:] + points[:-1]) // 2)
    profile = motion_profile(machine, *trajectory.at_offsets(at))
    speed = np.where(np.abs(profile.speed) > DEAD_BAND, profile.speed, 0.0)
    oil = machine.config.circuit
    friction = _friction(oil.coulomb_friction, oil.viscous_friction, oil.friction_speed, speed)
    force = profile.force + profile.inertia + machine.frictions * friction
    return Loads(at / SECOND_NS, speed, profile.force, force)


def tight(machine: Machine) -> Machine:
    """The machine with valves that do not leak."""
    return machine.with_values({LEAKAGE_KEY: 0.0})


def needed_supply(machine: Machine, loads: Loads) -> float:
    """The constant pressure [Pa] with which valves alone do all of a motion.

    p = max over time and joints of p_L + m(v) + margin, to hold where nothing moves.
    """
    return float(required_pressures(machine.arrays, loads.static, loads.speed).max())


def constant_pressure(machine: Machine, loads: Loads, supply: float) -> Taken:
    """P = p (Σ A_dir |v| + n q(p)): a pressure-controlled pump at p, valves throttle the rest.

    supply: p [Pa]. Source: H. E. Merritt, Hydraulic Control Systems (constant pressure supply).
    """
    oil, n = oil_of(machine.arrays), machine.joint_count
    power = supply * (loads.inflow(machine) + n * leakage(oil, supply))
    return _from_one_pump(machine, loads, power)


def load_sensing(machine: Machine, loads: Loads, margin: float) -> Taken:
    """P = p(t) (Σ A_dir |v| + n q(p)), p = max(p_T + Δp, max_j p_L,j + max(Δp, m_j)).

    The one pump follows the highest load pressure of all cylinders that move; what is held signals
    nothing, closed valves hold it. Ideal: no lines, no compensators' own drop, at once. margin:
    Δp [Pa]. Source: J. Siebert, M. Wydra, M. Geimer, Energies 2017, 10, 941 (losses of load sensing
    with actuators in parallel); P. Casoli et al., Actuators 2020, 9, 39.
    """
    m, oil = machine.arrays, oil_of(machine.arrays)
    own = _load_pressure(m.cap_area, m.rod_area, oil.tank_pressure, loads.force, loads.speed)
    drop = _valve_margin(m.valve_coefficient, m.cap_area, m.rod_area, loads.speed)
    own = np.where(loads.speed != 0.0, own + np.maximum(margin, drop), -np.inf)
    supply = np.maximum(oil.tank_pressure + margin, own.max(axis=1))
    leaks = machine.joint_count * np.array([leakage(oil, p) for p in supply])
    return _from_one_pump(machine, loads, supply * (loads.inflow(machine) + leaks))


class PumpMap(NamedTuple):
    """Efficiency map of the pumps of all cylinders together: P/η + P_d at the shafts [W]."""

    efficiency: float
    drag_power: float


def pump_controlled(machine: Machine, loads: Loads, pumps: PumpMap, recovering: bool) -> Taken:
    """P_j = (F_j − (A − a) p_T) v_j: a pump of its own for each cylinder, no valve in between.

    The pump lies between the chambers; pilot-operated check valves keep that with less load at
    p_T and take the difference (A − a) v from the reservoir. F > (A − a) p_T loads the cap side:
    (p_A − p_T) A v; less loads the rod side: (p_T − p_B) a v; both are P. At the shafts P/η + P_d;
    lowering gives back η |P| where that is recovering, and is braked for nothing where not. Loads
    are held by lock valves; nothing leaks but within η. Source: R. Rahmfeld, M. Ivantysynova,
    Displacement controlled linear actuator with differential cylinder, 5th ICFP 2001; P. Casoli
    et al., Actuators 2020, 9, 39.
    """
    m = machine.arrays
    power = (loads.force - (m.cap_area - m.rod_area) * m.tank_pressure) * loads.speed
    given, back = np.maximum(0.0, power), np.minimum(0.0, power) * recovering
    hydraulic = (given + back).sum(axis=1)
    shaft = (given / pumps.efficiency + back * pumps.efficiency).sum(axis=1)
    drag = pumps.drag_power * loads.duration
    return Taken(loads.integral(hydraulic), loads.integral(shaft) + drag)


def pump_maps(machine: Machine) -> Mapping[str, PumpMap]:
    """Pumps like the machine's servo pumps, and pumps like its main one, together of its size."""
    oil, n = machine.config.circuit, machine.joint_count
    return {
        "servo pumps": PumpMap(
            machine.arrays.servo_pump_efficiency, n * oil.servo_pump_drag_power
        ),
        "piston pumps": PumpMap(oil.main_pump_efficiency, oil.main_pump_drag_power),
    }


def boosted(machine: Machine, trajectory: Trajectory, schedule: ModeSchedule) -> Taken:
    """MHSB as it is planned: main pump at P_S, servo pumps in series (`motion_energy`)."""
    energy = motion_energy(machine, trajectory, schedule)
    main = shaft_of_main_pump(machine, energy.main_pump, trajectory.duration_ns / SECOND_NS)
    given = energy.servo_pumps - energy.servo_pump_losses
    return Taken(main.hydraulic_j + given, main.shaft_j + energy.servo_pumps)


def shaft_of_main_pump(machine: Machine, hydraulic: float, duration: float) -> Taken:
    """P/η + P_d at the shaft, by the map of the machine's main pump, as large as it has to be."""
    oil = machine.config.circuit
    drag = oil.main_pump_drag_power * duration
    return Taken(hydraulic, hydraulic / oil.main_pump_efficiency + drag)


def _from_one_pump(machine: Machine, loads: Loads, power: FloatArray) -> Taken:
    return shaft_of_main_pump(machine, loads.integral(power), loads.duration)


def at_own_need(machine: Machine, loads: Loads) -> Taken:
    """`constant_pressure` at what this very motion needs."""
    return constant_pressure(machine, loads, needed_supply(machine, loads))


System = Callable[[Machine, Loads], Taken]


def rivals(machine: Machine) -> Mapping[str, System]:
    """The other supplies by name, each a function of a machine, which may be `tight`, and loads."""
    systems: dict[str, System] = {"constant pressure": at_own_need}
    for margin in MARGINS:
        name = f"load sensing, {margin / 1e6:g} MPa"
        systems[name] = partial(load_sensing, margin=margin)
    for kind, pumps in pump_maps(machine).items():
        for ending, recovering in (("", False), (", recovering", True)):
            systems[f"pump control, {kind}{ending}"] = partial(
                pump_controlled, pumps=pumps, recovering=recovering
            )
    return systems
