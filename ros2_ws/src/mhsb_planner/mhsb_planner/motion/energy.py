"""Energy of a time trajectory with its mode schedule, in both readings, and where it goes.

E = Σ_j ∫ price_j (A_dir|v_j| + q_leak) dt. In N the price is P_S, whatever the load. Boosted it is
p_L/η as the paper writes it (never less than P_S), or P_S + (p_supply − P_S)/η, as main pump and
servo pump work in series, with p_supply of `hydraulics.boosted_supply`, in SB the rail's. Within
the dead band a cylinder is held. With pumps in series valves leak by that pressure
(`hydraulics.leakage`); in the paper's reading, whose flows know no pressure, as at P_S.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.hydraulics import (
    boosted_supply,
    inlet_area,
    leakage,
    load_pressure,
    oil_of,
    rail_pressure,
    supply_in,
)
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.modes import BOOSTED
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_model.types import FloatArray, IntArray, ModeArray
from mhsb_planner.motion.motion_profile import motion_profile
from mhsb_planner.motion.s3_limits import DEAD_BAND

QUADRATURE_SPACING_NS = 10_000_000
"""Longest interval of the midpoint rule."""


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


NOTHING = Energy(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def motion_energy(machine: Machine, trajectory: Trajectory, schedule: ModeSchedule) -> Energy:
    """Energy from the trajectory's first to its last point, leakage included."""
    edges = _edges(trajectory, schedule)
    if len(edges) < 2:
        return NOTHING
    parts = np.maximum(1, -(-np.diff(edges) // QUADRATURE_SPACING_NS))
    span = np.repeat(np.diff(edges) / parts, parts)
    middle = (np.cumsum(span) - span / 2).astype(np.int64)
    modes = schedule.modes_at_many(trajectory.stamp_ns + middle)
    q, qd, _ = trajectory.at_offsets(middle)
    return energy_of_states(machine, span / SECOND_NS, q, qd, modes)


def _edges(trajectory: Trajectory, schedule: ModeSchedule) -> IntArray:
    """Offsets between which both are smooth: the points, and what mode changes lie between."""
    switched = schedule.stamp_ns + schedule.offset_ns - trajectory.stamp_ns
    switched = switched[(switched > 0) & (switched < trajectory.duration_ns)]
    points = trajectory.offset_ns
    place = np.searchsorted(points, switched)
    between = points[place] != switched
    return np.insert(points, place[between], switched[between])


def energy_of_states(
    machine: Machine,
    span: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    modes: ModeArray,
) -> Energy:
    """Energy of states that last for `span` float64[k] s each; arrays of [k, n] in rad, rad/s."""
    profile = motion_profile(machine, position, velocity)
    power = _power(machine.arrays, profile.speed, profile.force, modes)
    return Energy(*(span @ power).tolist())


@kernel
def _power(
    m: MachineArrays, speed: FloatArray, force: FloatArray, modes: ModeArray
) -> FloatArray:
    """Power in the order of `Energy`'s fields, float64[k, 7] W; oracle: a hand calculation."""
    rows, n = speed.shape
    power = np.zeros((rows, 7))
    oil, efficiency = oil_of(m), m.servo_pump_efficiency
    normal, tank = oil.supply_pressure, oil.tank_pressure
    own = np.empty(n)
    for k in range(rows):
        for j in range(n):
            if BOOSTED[modes[k, j]]:
                cap, rod = m.cap_area[j], m.rod_area[j]
                own[j] = boosted_supply(oil, cap, rod, force[k, j], speed[k, j])
        rail = rail_pressure(oil, own, modes[k])
        for j in range(n):
            cap, rod = m.cap_area[j], m.rod_area[j]
            v, f = speed[k, j], force[k, j]
            stroke = inlet_area(cap, rod, v) * abs(v)
            paper = normal
            if BOOSTED[modes[k, j]]:
                direction = v if abs(v) > DEAD_BAND else f
                paper = max(paper, load_pressure(cap, rod, tank, f, direction) / efficiency)
            supply = supply_in(oil, modes[k, j], own[j], rail)
            leaks = leakage(oil, supply)
            shaft = (supply - normal) / efficiency * (stroke + leaks)
            power[k, 0] += paper * (stroke + oil.leakage_flow)
            power[k, 1] += normal * (stroke + leaks)
            power[k, 2] += shaft
            power[k, 3] += (1.0 - efficiency) * shaft
            power[k, 4] += (supply - tank) * leaks
            power[k, 5] += f * v
            power[k, 6] += tank * (inlet_area(cap, rod, -v) * abs(v) + leaks)
    return power
