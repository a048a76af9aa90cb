"""Energy of a time trajectory with its mode schedule, in both readings, and where it goes.

E = Σ_j ∫ price_j (A_dir|v_j| + q_leak) dt. In N the price is P_S, whatever the load. Boosted it is
p_L/η as the paper writes it (never less than P_S), or P_S + (p_supply − P_S)/η, as main pump and
servo pump work in series. p_supply is what holding the load and what moving it need,
max(P_S, p_L(0), p_L(v) + m(v)) + margin, at most the highest boost pressure: a servo pump carries
the load of its cylinder whichever way that moves, since it has to be carried at every reversal.
In SB it is the rail's, the highest of all its actuators. Within the dead band a cylinder is held.
With pumps in series a valve leaks q_leak √((p_supply − p_T)/(P_S − p_T)), an orifice rated at P_S.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.hydraulics import Oil, inlet_area, load_pressure, oil_of, pressure_to_move
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.modes import BOOSTED, ON_RAIL
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
def boosted_supply(oil: Oil, cap: float, rod: float, force: float, speed: float) -> float:
    """Pressure [Pa] to which a servo pump charges the line of a boosted cylinder."""
    need = pressure_to_move(oil, cap, rod, force, 0.0)
    if abs(speed) > DEAD_BAND:
        need = max(need, pressure_to_move(oil, cap, rod, force, speed))
    return max(oil.supply_pressure, min(need, oil.max_boost_pressure))


@kernel
def _power(
    m: MachineArrays, speed: FloatArray, force: FloatArray, modes: ModeArray
) -> FloatArray:
    """Power in the order of `Energy`'s fields, float64[k, 7] W; oracle: a hand calculation."""
    rows, n = speed.shape
    power = np.zeros((rows, 7))
    oil, efficiency = oil_of(m), m.servo_pump_efficiency
    normal, tank = oil.supply_pressure, oil.tank_pressure
    for k in range(rows):
        rail = normal
        for j in range(n):
            if ON_RAIL[modes[k, j]]:
                cap, rod = m.cap_area[j], m.rod_area[j]
                rail = max(rail, boosted_supply(oil, cap, rod, force[k, j], speed[k, j]))
        for j in range(n):
            cap, rod = m.cap_area[j], m.rod_area[j]
            v, f = speed[k, j], force[k, j]
            stroke = inlet_area(cap, rod, v) * abs(v)
            paper = supply = normal
            if BOOSTED[modes[k, j]]:
                direction = v if abs(v) > DEAD_BAND else f
                paper = max(paper, load_pressure(cap, rod, tank, f, direction) / efficiency)
                supply = rail
                if not ON_RAIL[modes[k, j]]:
                    supply = boosted_supply(oil, cap, rod, f, v)
            leakage = oil.leakage_flow * math.sqrt((supply - tank) / (normal - tank))
            shaft = (supply - normal) / efficiency * (stroke + leakage)
            power[k, 0] += paper * (stroke + oil.leakage_flow)
            power[k, 1] += normal * (stroke + leakage)
            power[k, 2] += shaft
            power[k, 3] += (1.0 - efficiency) * shaft
            power[k, 4] += (supply - tank) * leakage
            power[k, 5] += f * v
            power[k, 6] += tank * (inlet_area(cap, rod, -v) * abs(v) + leakage)
    return power
