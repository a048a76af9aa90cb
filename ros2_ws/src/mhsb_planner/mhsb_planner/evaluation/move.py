"""One move as its picture needs it, whether it was planned, simulated or recorded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mhsb_model.hydraulics import (
    boosted_supply,
    load_pressure,
    oil_of,
    rail_pressure,
    supply_in,
)
from mhsb_model.machine import Machine
from mhsb_model.modes import BOOSTED
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.types import FloatArray, ModeArray, Position
from mhsb_planner.motion.energy import Energy
from mhsb_planner.motion.motion_profile import motion_profile
from mhsb_planner.motion.s3_limits import DEAD_BAND
from mhsb_planner.plan import Plan

INSTANTS = 601


@dataclass(frozen=True, eq=False)
class Move:
    """A motion of n joints at k instants.

    machine    that moved, or was to
    title      of the picture
    goals      in `base_link`, m, in their order
    time       float64[k] s
    position   float64[k, n] rad
    reference  float64[k, n] rad that the servo followed; None where nothing was measured
    modes      uint8[k, n] in force
    speed      float64[k, n] m/s of the pistons, positive extending
    force      float64[k, n] N of the cylinders, positive resists extension
    supply     float64[k, n] Pa in each actuator's line
    chambers   by name float64[k, n] Pa, what else is drawn beside it
    energy     J by name, from the pumps and to where it went: positive is used, negative given
    counted    by whom the energy was
    """

    machine: Machine
    title: str
    goals: tuple[Position, ...]
    time: FloatArray
    position: FloatArray
    reference: FloatArray | None
    modes: ModeArray
    speed: FloatArray
    force: FloatArray
    supply: FloatArray
    chambers: Mapping[str, FloatArray]
    energy: Mapping[str, float]
    counted: str

    @property
    def tip(self) -> FloatArray:
        """Places of the tip in the arm's plane, float64[k, 2] m."""
        return self.machine.tip_positions(self.position)

    @property
    def goals_in_plane(self) -> list[tuple[float, float]]:
        """The goals in the arm's plane when it is there, (x, z) m each."""
        places = [self.machine.from_the_side(goal).tolist() for goal in self.goals]
        return [(x, z) for x, z in places]

    @property
    def duration(self) -> float:
        """From the first instant to the last [s]."""
        return float(self.time[-1] - self.time[0])


def planned_move(machine: Machine, plan: Plan, goal: Position, title: str) -> Move:
    """A plan's motion: static forces, the pressures that the planner counts on, its energy."""
    trajectory, schedule = plan.motion.trajectory, plan.motion.schedule
    offset_ns = np.linspace(0, trajectory.duration_ns, INSTANTS).astype(np.int64)
    time_ns = trajectory.stamp_ns + offset_ns
    position, velocity, _ = trajectory.sample_many(time_ns)
    modes = schedule.modes_at_many(time_ns)
    profile = motion_profile(machine, position, velocity)
    return Move(
        machine=machine,
        title=title,
        goals=(goal,),
        time=offset_ns / SECOND_NS,
        position=position,
        reference=None,
        modes=modes,
        speed=profile.speed,
        force=profile.force,
        supply=planned_supply(machine, profile.force, profile.speed, modes),
        chambers={"the load's, $p_L$": load_pressures(machine, profile.force, profile.speed)},
        energy=energy_of_plan(plan.energy),
        counted="the planner's model",
    )


def planned_supply(
    machine: Machine, force: FloatArray, speed: FloatArray, modes: ModeArray
) -> FloatArray:
    """Pressure of the actuators' lines as planned, float64[k, n] Pa: P_S, own boost, the rail's."""
    m, oil = machine.arrays, oil_of(machine.arrays)
    own_of = list(zip(m.valve_coefficient, m.cap_area, m.rod_area, strict=True))
    supply = np.empty_like(force)
    for k, pattern in enumerate(modes):
        own = np.array([
            boosted_supply(oil, *own_of[j], force[k, j], speed[k, j])
            if BOOSTED[pattern[j]]
            else oil.supply_pressure
            for j in range(machine.joint_count)
        ])  # fmt: skip
        rail = rail_pressure(oil, own, pattern)
        supply[k] = [
            supply_in(oil, mode, each, rail) for mode, each in zip(pattern, own, strict=True)
        ]
    return supply


def load_pressures(machine: Machine, force: FloatArray, speed: FloatArray) -> FloatArray:
    """p_L of each actuator in its direction, at rest against its load, float64[k, n] Pa."""
    m, tank = machine.arrays, machine.arrays.tank_pressure
    direction = np.where(np.abs(speed) > DEAD_BAND, speed, force)
    return np.array([
        [
            load_pressure(m.cap_area[j], m.rod_area[j], tank, force[k, j], direction[k, j])
            for j in range(machine.joint_count)
        ]
        for k in range(len(force))
    ])  # fmt: skip


def energy_of_plan(energy: Energy) -> dict[str, float]:
    """Where the planner's model, with pumps in series, has the energy go [J]."""
    return {
        "main pump": -energy.main_pump,
        "servo pumps": -energy.servo_pumps,
        "work on the loads": energy.piston_work,
        "throttling": energy.servo_valves,
        "leakage": energy.leakage,
        "oil to the tank": energy.return_oil,
        "servo pump losses": energy.servo_pump_losses,
    }
