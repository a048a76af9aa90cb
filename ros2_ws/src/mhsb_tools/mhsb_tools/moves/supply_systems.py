"""Energy of a motion with other supplies: constant pressure, load sensing, pump control.

Quasi-steady energy models of the same cylinders on the same motion. All pumps are ideal except for
their efficiency maps. Energy is counted at two boundaries: *hydraulic* is the energy that all pumps
give to the oil, *shaft* the energy at the shafts of the pumps. Load pressure p_L, valve drop m(v),
inlet area A_dir and leakage q(p) of a valve are defined in `mhsb_model.hydraulics`.

A supply that is set beforehand follows the static loads, as plans do, with the machine's boost
margin for inertia and friction. A supply that follows measured pressures sees the whole force F,
including inertia and friction.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from mhsb_model.holding import MAX_HELD_SPEED
from mhsb_model.hydraulics import (
    compute_required_pressures,
    compute_valve_drop,
    compute_valve_leakage,
    get_shared_hydraulics,
    load_pressure,
)
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_model.types import FloatArray
from mhsb_planner.errors import RequestError
from mhsb_planner.motion.energy import compute_motion_energy
from mhsb_planner.motion.motion_profile import compute_motion_profile
from mhsb_tools.moves.needed_pressure import compute_moving_forces

LOAD_SENSING_MARGINS = (1e6, 2e6)
"""Pressure margins Δp of load sensing [Pa], the low and the high end of what is usual."""

LEAKAGE_KEY = "hydraulics.valve.leakage_flow"
"""Path of the valves' leakage flow in the machine file."""

_load_pressure = np.vectorize(load_pressure, otypes=[float])
_valve_margin = np.vectorize(compute_valve_drop, otypes=[float])


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
        speed: Piston speed, positive extending, shape (k, n) [m/s]. Speeds up to MAX_HELD_SPEED
            count as 0.
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
        """Compute the flow that all cylinders together take through their valves.

            Q = Σ A_dir |v|

        A_dir is the area of the cap side if the cylinder extends, else of the rod side [m²]; v is
        the piston speed [m/s].

        Args:
            machine: The arm.

        Returns:
            Flow Q at each instant, shape (k,) [m³/s].
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


def compute_loads(machine: Machine, trajectory: Trajectory) -> MotionLoads:
    """Compute piston speeds and piston forces during a trajectory.

    They are computed at the trajectory's points and half-way between neighbouring points. A piston
    speed up to MAX_HELD_SPEED counts as 0.

    Args:
        machine: The arm.
        trajectory: The motion.

    Returns:
        Speeds and forces at these instants, with and without inertia and friction.
    """
    points = trajectory.offset_ns
    at = np.union1d(points, (points[1:] + points[:-1]) // 2)
    profile = compute_motion_profile(machine, *trajectory.sample_offsets(at))
    speed = np.where(np.abs(profile.speed) > MAX_HELD_SPEED, profile.speed, 0.0)
    force = compute_moving_forces(machine, replace(profile, speed=speed))
    return MotionLoads(at / SECOND_NS, speed, profile.force, force)


def remove_leakage(machine: Machine) -> Machine:
    """Return the machine with valves that do not leak."""
    return machine.with_values({LEAKAGE_KEY: 0.0})


def compute_needed_supply(machine: Machine, loads: MotionLoads) -> float:
    """Return the lowest constant supply pressure with which a motion needs no boost.

        p = max over time and joints of (p_L + m(v) + margin)

    p_L is the load pressure of the static load, m(v) the pressure drop of the fully open valve at
    piston speed v, and margin the machine's boost margin [Pa]. While a cylinder stands still, p_L
    is the pressure that holds its load.

    Args:
        machine: The arm.
        loads: Motion. Only its piston speeds and static forces are read.

    Returns:
        The pressure p [Pa].
    """
    return float(compute_required_pressures(machine.arrays, loads.static, loads.speed).max())


def compute_constant_pressure_energy(
    machine: Machine, loads: MotionLoads, supply: float
) -> SupplyEnergy:
    """Compute the energy of a motion with one pump that keeps its pressure constant.

        P = p (Σ A_dir |v| + n q(p))

    P is the power to the oil [W], A_dir the inlet area of a cylinder [m²], v its piston speed
    [m/s], n the number of joints and q(p) the leakage of a valve [m³/s]. Valves throttle the
    pressure that a load does not need.

    Args:
        machine: The arm.
        loads: Motion. Only its piston speeds are read.
        supply: Constant pressure p [Pa].

    Returns:
        Energy to the oil, and at the pump's shaft by the main pump's efficiency map.

    Source:
        H. E. Merritt, Hydraulic Control Systems (constant pressure supply).
    """
    oil, n = get_shared_hydraulics(machine.arrays), machine.joint_count
    power = supply * (loads.inflow(machine) + n * compute_valve_leakage(oil, supply))
    return _from_one_pump(machine, loads, power)


class SingleSupply(NamedTuple):
    """One pump at constant pressure that does a motion without boost.

    Attributes:
        pressure: Lowest sufficient supply pressure [Pa].
        energy_j: Energy to the oil [J].
    """

    pressure: float
    energy_j: float

    def describe_saving(self, energy_j: float) -> str:
        """Describe what the arm's own supply saves against one pump at constant pressure.

        Args:
            energy_j: Energy that the same motion takes with the arm's own supply [J], such as
                `plan.energy.series`.

        Returns:
            Text such as `528.5 J, saves 32 % against one pump at constant 7.1 MPa for this motion
            (779.7 J)`. If the arm's own supply takes more, the text has `costs 5 % more than`
            instead.
        """
        saved = 1.0 - energy_j / self.energy_j if self.energy_j > 0.0 else 0.0
        words = "saves {:.0f} % against" if saved >= 0.0 else "costs {:.0f} % more than"
        return (
            f"{energy_j:.1f} J, {words.format(100 * abs(saved))} one pump at constant "
            f"{1e-6 * self.pressure:.1f} MPa for this motion ({self.energy_j:.1f} J)"
        )


def compute_single_supply(machine: Machine, trajectory: Trajectory) -> SingleSupply:
    """Compute what a motion takes with one pump at constant pressure and without boost.

    The pressure is the lowest that suffices throughout the motion. If this energy exceeds the
    plan's (with boosted oil priced as `series`), the difference is what boost saves.

    Args:
        machine: The arm.
        trajectory: The motion, such as `plan.motion.trajectory`.

    Returns:
        Pressure by `compute_needed_supply`, and energy by `compute_constant_pressure_energy`.

    Raises:
        RequestError: The motion is not a `Trajectory`.
    """
    if not isinstance(trajectory, Trajectory):
        rule = "must be a Trajectory, such as plan.motion.trajectory"
        raise RequestError("trajectory", trajectory, rule)
    loads = compute_loads(machine, trajectory)
    supply = compute_needed_supply(machine, loads)
    taken = compute_constant_pressure_energy(machine, loads, supply)
    return SingleSupply(supply, taken.hydraulic_j)


def load_sensing(machine: Machine, loads: MotionLoads, margin: float) -> SupplyEnergy:
    """Compute the energy of a motion with one pump that follows the highest load pressure.

        P = p (Σ A_dir |v| + n q(p))
        p = max(p_T + Δp, max_j (p_L,j + max(Δp, m_j)))

    P is the power to the oil [W] and p the pump's pressure [Pa], both at each instant. A_dir is the
    inlet area of a cylinder [m²], v its piston speed [m/s], n the number of joints, q(p) the
    leakage of a valve [m³/s] and p_T the tank pressure. p_L,j is the load pressure of cylinder j
    with inertia and friction, and m_j the pressure drop of its fully open valve.

    Only cylinders that move count in the maximum over j; the others are held by closed valves. The
    system is ideal: no line losses, no pressure drop in compensators, no delay.

    Args:
        machine: The arm.
        loads: Motion. Only its piston speeds and forces are read.
        margin: Pressure margin Δp of load sensing [Pa].

    Returns:
        Energy to the oil, and at the pump's shaft by the main pump's efficiency map.

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


def compute_pump_control_energy(
    machine: Machine, loads: MotionLoads, pumps: PumpMap, recovering: bool
) -> SupplyEnergy:
    """Compute the energy of a motion if each cylinder has its own pump and no valve.

        P_j = (F_j − (A − a) p_T) v_j

    P_j is the power of pump j to the oil [W]; A and a are the areas of cap side and rod side [m²],
    and p_T is the tank pressure [Pa]. The pump is connected to both chambers. Pilot-operated check
    valves keep the chamber with less load at p_T and exchange the flow (A − a) v with the
    reservoir.

    At P_j > 0 the shaft takes P_j/η. At P_j < 0 a load lowers: the shaft gets back η |P_j| if
    `recovering`, else nothing. The shafts also take the drag P_d during the whole motion. Lock
    valves hold loads at rest without energy. Leakage counts only as part of η.

    Args:
        machine: The arm.
        loads: Motion. Only its piston speeds v [m/s] and forces F with inertia and friction [N] are
            read.
        pumps: Efficiency η, and drag power P_d of all pumps together [W].
        recovering: Whether lowering loads drive their pumps and give energy back.

    Returns:
        Energy to the oil minus the recovered energy, and energy at the pumps' shafts.

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


def make_pump_maps(machine: Machine) -> Mapping[str, PumpMap]:
    """Return the efficiency maps of the pumps that pump control is computed with.

    Args:
        machine: The arm.

    Returns:
        Two maps by kind of pump; each is for the pumps of all n cylinders together. `servo pumps`
        has efficiency and n times the drag of one of the machine's servo pumps. `piston pumps` has
        efficiency and drag of the machine's main pump.
    """
    oil, n = machine.config.circuit, machine.joint_count
    return {
        "servo pumps": PumpMap(machine.arrays.servo_pump_efficiency, n * oil.servo_pump_drag_power),
        "piston pumps": PumpMap(oil.main_pump_efficiency, oil.main_pump_drag_power),
    }


def compute_mhsb_energy(
    machine: Machine, trajectory: Trajectory, schedule: ModeSchedule
) -> SupplyEnergy:
    """Compute the planned energy of a motion with MHSB, the arm's own supply.

    The main pump runs at P_S, and servo pumps of booster modules lift the pressure in series with
    it.

    Args:
        machine: The arm.
        trajectory: The motion.
        schedule: Mode schedule of the motion.

    Returns:
        Energy that all pumps give to the oil, and energy at their shafts. The losses of the servo
        pumps count only at the shafts.
    """
    energy = compute_motion_energy(machine, trajectory, schedule)
    main = add_main_pump_shaft(machine, energy.main_pump, trajectory.duration_ns / SECOND_NS)
    given = energy.servo_pumps - energy.servo_pump_losses
    return SupplyEnergy(main.hydraulic_j + given, main.shaft_j + energy.servo_pumps)


def add_main_pump_shaft(machine: Machine, hydraulic: float, duration: float) -> SupplyEnergy:
    """Compute the main pump's shaft energy from the energy that it gives to the oil.

        E_shaft = E/η + P_d T

    Args:
        machine: The arm with the efficiency η and drag power P_d of its main pump.
        hydraulic: Energy E given to the oil [J].
        duration: Time T for which the pump runs [s].

    Returns:
        The energy E to the oil and the energy E_shaft at the shaft [J]. Whether the pump can
        deliver the flow is not checked.
    """
    oil = machine.config.circuit
    drag = oil.main_pump_drag_power * duration
    return SupplyEnergy(hydraulic, hydraulic / oil.main_pump_efficiency + drag)


def _from_one_pump(machine: Machine, loads: MotionLoads, power: FloatArray) -> SupplyEnergy:
    return add_main_pump_shaft(machine, loads.integral(power), loads.duration)


def compute_needed_pressure_energy(machine: Machine, loads: MotionLoads) -> SupplyEnergy:
    """Compute the energy at the lowest constant pressure that does this very motion."""
    return compute_constant_pressure_energy(machine, loads, compute_needed_supply(machine, loads))


System = Callable[[Machine, MotionLoads], SupplyEnergy]


def baselines(machine: Machine) -> Mapping[str, System]:
    """Return the supplies with which MHSB is compared, as functions that compute their energy.

    They are constant pressure at the lowest level that each motion needs, and load sensing with
    each of `LOAD_SENSING_MARGINS`. Then comes pump control with each of `make_pump_maps`, with and
    without recovery of energy.

    Args:
        machine: The arm. Only its pump efficiencies are used.

    Returns:
        Functions by name of the supply. Each takes a machine (with or without leakage) and the
        speeds and forces of a motion, and returns the motion's energy.
    """
    systems: dict[str, System] = {"constant pressure": compute_needed_pressure_energy}
    for margin in LOAD_SENSING_MARGINS:
        name = f"load sensing, {margin / 1e6:g} MPa"
        systems[name] = partial(load_sensing, margin=margin)
    for kind, pumps in make_pump_maps(machine).items():
        for ending, recovering in (("", False), (", recovering", True)):
            systems[f"pump control, {kind}{ending}"] = partial(
                compute_pump_control_energy, pumps=pumps, recovering=recovering
            )
    return systems
