"""Energy of a time trajectory with its mode schedule, in both readings, and where it goes.

E = Σ_j ∫ price_j (A_dir|v_j| + q_leak) dt. In N the price is P_S, whatever the load. Boosted it is
p_L/η as the paper writes it (never less than P_S), or P_S + (p_supply − P_S)/η, as main pump and
servo pump work in series, with p_supply of `hydraulics.boosted_supply`, in SB the rail's. Within
the dead band a cylinder is held. With pumps in series valves leak by that pressure
(`hydraulics.leakage`), lines are charged before boosts begin (`charging`), and a boosted cylinder
that accelerates its load gets max(p_supply, p_L(F + inertia) + m(v) + margin/2), as the servo sees
to it; in the paper's reading, whose flows know neither pressure nor time, none of that counts.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.hydraulics import (
    Oil,
    boosted_supply,
    inlet_area,
    leakage,
    load_pressure,
    oil_of,
    pressure_to_move,
    rail_pressure,
    spared_margin,
    supply_in,
)
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.modes import BOOSTED
from mhsb_model.trajectory import POINT_SPACING_NS, SECOND_NS, Trajectory
from mhsb_model.types import FloatArray, IntArray, ModeArray
from mhsb_planner.motion.charging import charging_energy
from mhsb_planner.motion.motion_profile import MotionProfile, Profiles, motion_profile
from mhsb_planner.motion.s3_limits import DEAD_BAND, repeats


@dataclass(frozen=True)
class Energy:
    """Energy of a motion [J].

    paper              as the paper prices boost
    main_pump          delivered by it; this and the following with pumps in series
    servo_pumps        shaft work
    servo_pump_losses  the part of that which does not reach the oil
    leakage            through the valves to the tank
    piston_work        done against the static loads; negative where they are lowered
    return_oil         left in the oil that goes to the tank
    """

    paper: float
    main_pump: float
    servo_pumps: float
    servo_pump_losses: float
    leakage: float
    piston_work: float
    return_oil: float

    @property
    def series(self) -> float:
        """Delivered by pumps in series."""
        return self.main_pump + self.servo_pumps

    @property
    def servo_valves(self) -> float:
        """Lost in the metering edges of the servo valves: what remains of `series`."""
        used = self.servo_pump_losses + self.leakage + self.piston_work + self.return_oil
        return self.series - used


FIELDS = len(fields(Energy))
NOTHING = Energy(*[0.0] * FIELDS)


def motion_energy(
    machine: Machine,
    trajectory: Trajectory,
    schedule: ModeSchedule,
    known: Profiles | None = None,
) -> Energy:
    """Energy from the trajectory's first to its last point, leakage included.

    By the trapezoidal rule over halves of intervals: power jumps where a boosted load begins to
    move, and a rule of higher order gains nothing there.

    known  the trajectory's profiles at its points, at which alone modes then change
    """
    edges = trajectory.offset_ns if known is not None else _edges(trajectory, schedule)
    if len(edges) < 2:
        return NOTHING
    points, middles, modes = known or _profiles(machine, trajectory, schedule, edges)
    energy = _energy(
        machine.arrays,
        (edges[1:] - edges[:-1]) / SECOND_NS,
        points.speed,
        points.force,
        points.inertia,
        middles.speed,
        middles.force,
        middles.inertia,
        modes,
    )
    return _with_charging(machine, Energy(*energy.tolist()), points, modes)


def _with_charging(
    machine: Machine, energy: Energy, profile: MotionProfile, modes: ModeArray
) -> Energy:
    """With what charges lines before boosts; rows of modes begin at those of the profile."""
    charging = charging_energy(machine, profile.speed, profile.force, modes)
    if charging == 0.0:
        return energy
    losses = (1.0 - machine.arrays.servo_pump_efficiency) * charging
    return replace(
        energy,
        servo_pumps=energy.servo_pumps + charging,
        servo_pump_losses=energy.servo_pump_losses + losses,
    )


def _profiles(
    machine: Machine, trajectory: Trajectory, schedule: ModeSchedule, edges: IntArray
) -> Profiles:
    """Of a motion between offsets at which alone modes change."""
    points, middles = (
        motion_profile(machine, *trajectory.at_offsets(at))
        for at in (edges, (edges[1:] + edges[:-1]) // 2)
    )
    return Profiles(points, middles, schedule.modes_at_many(trajectory.stamp_ns + edges[:-1]))


def _edges(trajectory: Trajectory, schedule: ModeSchedule) -> IntArray:
    """Offsets between which both are smooth: the points, and what mode changes lie between.

    Where they are farther apart than a planner's points, others are put between.
    """
    switched = schedule.stamp_ns + schedule.offset_ns - trajectory.stamp_ns
    switched = switched[(switched > 0) & (switched < trajectory.duration_ns)]
    edges = np.union1d(trajectory.offset_ns, switched)
    parts = np.maximum(1, -(-np.diff(edges) // POINT_SPACING_NS))
    part = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
    between = part * np.repeat(np.diff(edges), parts) // np.repeat(parts, parts)
    return np.append(np.repeat(edges[:-1], parts) + between, edges[-1])


def energy_of_states(
    machine: Machine,
    span: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    modes: ModeArray,
    acceleration: FloatArray | None = None,
) -> Energy:
    """Energy of states that last for `span` float64[k] s each; arrays of [k, n] in rad, rad/s and,
    where inertia counts, rad/s²."""
    profile = motion_profile(machine, position, velocity, acceleration)
    energy = _sum(machine.arrays, span, profile.speed, profile.force, profile.inertia, modes)
    return _with_charging(machine, Energy(*energy.tolist()), profile, modes)


@kernel
def _sum(
    m: MachineArrays,
    span: FloatArray,
    speed: FloatArray,
    force: FloatArray,
    inertia: FloatArray,
    modes: ModeArray,
) -> FloatArray:
    """Energy of states that last for `span` [s], in the order of `Energy`'s fields."""
    oil, efficiency = oil_of(m), m.servo_pump_efficiency
    valve, cap, rod = m.valve_coefficient, m.cap_area, m.rod_area
    energy, power, own = np.zeros(FIELDS), np.empty(FIELDS), np.empty(speed.shape[1])
    for k in range(len(span)):
        _put_power(
            oil, valve, cap, rod, efficiency, speed, force, inertia, k, modes, k, own, power
        )
        for i in range(FIELDS):
            energy[i] += span[k] * power[i]
    return energy


@kernel
def _energy(
    m: MachineArrays,
    span: FloatArray,
    speed: FloatArray,
    force: FloatArray,
    inertia: FloatArray,
    middle_speed: FloatArray,
    middle_force: FloatArray,
    middle_inertia: FloatArray,
    modes: ModeArray,
) -> FloatArray:
    """Energy of intervals of `span` [s], by trapezoids over halves, in the order of the fields."""
    oil, efficiency = oil_of(m), m.servo_pump_efficiency
    valve, cap, rod = m.valve_coefficient, m.cap_area, m.rod_area
    energy, own = np.zeros(FIELDS), np.empty(speed.shape[1])
    begin, middle, end = np.empty(FIELDS), np.empty(FIELDS), np.empty(FIELDS)
    for k in range(len(span)):
        if repeats(modes, k):
            for i in range(FIELDS):
                begin[i] = end[i]
        else:
            _put_power(
                oil, valve, cap, rod, efficiency, speed, force, inertia, k, modes, k, own, begin
            )
        _put_power(
            oil, valve, cap, rod, efficiency, middle_speed, middle_force, middle_inertia, k, modes,
            k, own, middle,
        )  # fmt: skip
        _put_power(
            oil, valve, cap, rod, efficiency, speed, force, inertia, k + 1, modes, k, own, end
        )
        for i in range(FIELDS):
            energy[i] += 0.25 * span[k] * (begin[i] + 2.0 * middle[i] + end[i])
    return energy


@kernel(inline="always")
def _put_power(
    oil: Oil,
    valve: FloatArray,
    cap: FloatArray,
    rod: FloatArray,
    efficiency: float,
    speed: FloatArray,
    force: FloatArray,
    inertia: FloatArray,
    i: int,
    modes: ModeArray,
    k: int,
    own: FloatArray,
    power: FloatArray,
) -> None:
    """Write what state i takes in the modes of row k to power[FIELDS] [W], as `Energy`'s fields.

    own[n] is working memory. Oracle: a hand calculation.
    """
    normal, tank = oil.supply_pressure, oil.tank_pressure
    at_paper = main_pump = shafts = leaked = work = returned = 0.0
    for j in range(len(own)):
        if BOOSTED[modes[k, j]]:
            f, v = force[i, j], speed[i, j]
            own[j] = boosted_supply(oil, valve[j], cap[j], rod[j], f, v)
            if inertia[i, j] != 0.0:
                load = f + inertia[i, j]
                pushed = pressure_to_move(oil, valve[j], cap[j], rod[j], load, v)
                pushed = min(pushed - spared_margin(oil), oil.max_boost_pressure)
                own[j] = max(own[j], pushed)
    rail = rail_pressure(oil, own, modes[k])
    for j in range(len(own)):
        v, f = speed[i, j], force[i, j]
        stroke = inlet_area(cap[j], rod[j], v) * abs(v)
        paper, supply, leaks, shaft = normal, normal, oil.leakage_flow, 0.0
        if BOOSTED[modes[k, j]]:
            direction = v if abs(v) > DEAD_BAND else f
            paper = max(paper, load_pressure(cap[j], rod[j], tank, f, direction) / efficiency)
            supply = supply_in(oil, modes[k, j], own[j], rail)
            leaks = leakage(oil, supply)
            shaft = (supply - normal) / efficiency * (stroke + leaks)
        at_paper += paper * (stroke + oil.leakage_flow)
        main_pump += normal * (stroke + leaks)
        shafts += shaft
        leaked += (supply - tank) * leaks
        work += f * v
        returned += tank * (inlet_area(cap[j], rod[j], -v) * abs(v) + leaks)
    power[0], power[1], power[2] = at_paper, main_pump, shafts
    power[3], power[4] = (1.0 - efficiency) * shafts, leaked
    power[5], power[6] = work, returned
