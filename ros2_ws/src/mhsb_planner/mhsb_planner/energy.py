"""Energy of a time trajectory with its mode schedule, in both readings.

E = Σ_j ∫ price_j (A_dir|v_j| + q_leak) dt. In N the price is P_S, whatever the load. Boosted it is
p_L/η as the paper writes it (never less than P_S), or P_S + max(0, p_supply − P_S)/η, as main pump
and servo pump work in series, with p_supply = p_L + m(v) + margin; the rail's, the highest of all
actuators in SB, for each of these.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from mhsb_model.arrays import MachineArrays
from mhsb_model.hydraulics import inlet_area, load_pressure, required_pressure
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.modes import Mode
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_model.types import FloatArray, ModeArray
from mhsb_planner.motion_profile import motion_profile

QUADRATURE_SPACING_NS = 10_000_000
"""Longest interval of the midpoint rule."""


NORMAL, SHARED = int(Mode.N), int(Mode.SB)


@dataclass(frozen=True)
class Energy:
    """Energy [J] as the paper prices boost, and as pumps in series do."""

    paper: float
    series: float


def motion_energy(machine: Machine, trajectory: Trajectory, schedule: ModeSchedule) -> Energy:
    """Energy from the trajectory's first to its last point, leakage included."""
    switched = schedule.stamp_ns + schedule.offset_ns - trajectory.stamp_ns
    edges = np.union1d(trajectory.offset_ns, switched)
    edges = edges[(edges >= 0) & (edges <= trajectory.duration_ns)]
    if len(edges) < 2:
        return Energy(0.0, 0.0)
    parts = np.maximum(1, -(-np.diff(edges) // QUADRATURE_SPACING_NS))
    span = np.repeat(np.diff(edges) / parts, parts)
    middle = np.cumsum(span) - span / 2
    at_ns = trajectory.stamp_ns + middle.astype(np.int64)
    q, qd, _ = trajectory.sample_many(at_ns)
    profile = motion_profile(machine, q, qd)
    power = _power(machine.arrays, profile.speed, profile.force, schedule.modes_at_many(at_ns))
    paper, series = span / SECOND_NS @ power
    return Energy(float(paper), float(series))


@njit(cache=True, nogil=True)
def _power(
    m: MachineArrays, speed: FloatArray, force: FloatArray, modes: ModeArray
) -> FloatArray:
    """Power in both readings, float64[k, 2] W; its oracle in the tests is a hand calculation."""
    rows, n = speed.shape
    power = np.zeros((rows, 2))
    for k in range(rows):
        rail = m.supply_pressure
        for j in range(n):
            if modes[k, j] == SHARED:
                rail = max(rail, required_pressure(m, j, force[k, j], speed[k, j]))
        for j in range(n):
            cap, rod = m.cap_area[j], m.rod_area[j]
            paper = series = m.supply_pressure
            if modes[k, j] != NORMAL:
                direction = speed[k, j] if speed[k, j] != 0.0 else force[k, j]
                load = load_pressure(cap, rod, m.tank_pressure, force[k, j], direction)
                paper = max(paper, load / m.servo_pump_efficiency)
                supply = required_pressure(m, j, force[k, j], speed[k, j])
                if modes[k, j] == SHARED:
                    supply = rail
                series += max(0.0, supply - m.supply_pressure) / m.servo_pump_efficiency
            flow = inlet_area(cap, rod, speed[k, j]) * abs(speed[k, j]) + m.leakage_flow
            power[k, 0] += paper * flow
            power[k, 1] += series * flow
    return power
