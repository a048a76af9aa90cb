"""Record of one move for its picture, whether it was planned, simulated or recorded."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mhsb_model.holding import MAX_HELD_SPEED
from mhsb_model.hydraulics import compute_required_pressures, load_pressure
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.types import FloatArray, ModeArray, Position
from mhsb_planner.motion.energy import Energy
from mhsb_planner.motion.motion_profile import compute_motion_profile
from mhsb_planner.motion.planned_pressures import compute_planned_supply
from mhsb_planner.plan import Plan
from mhsb_tools.moves.supply_systems import compute_single_supply

SAMPLE_COUNT = 601
"""Number of instants at which a planned motion is sampled."""

REST_TOLERANCE = 1e-6
"""Largest distance of a resting joint from its last position [rad or m]. It exceeds rounding
errors, and motions cross it in the last hundredths of their time."""

SHOWN_REST = 0.05
"""Rest at the end of a move up to which its heading does not name it [s]."""


@dataclass(frozen=True, eq=False)
class MoveRecord:
    """A motion of n joints at k instants, with forces, pressures and energy.

    Attributes:
        machine: The arm that moved, or was to move.
        title: Title of the picture.
        goals: Goals in `base_link` [m], in order.
        time: Instants, shape (k,) [s].
        position: Joint positions, shape (k, n) [rad or m].
        reference: Reference that the servo followed, shape (k, n) [rad or m]; None if nothing was
            measured.
        modes: Modes in force, shape (k, n), uint8.
        speed: Piston speeds, positive extending, shape (k, n) [m/s].
        force: Piston forces, positive if the load resists extension, shape (k, n) [N].
        supply: Pressure in each actuator's supply line, shape (k, n) [Pa].
        chambers: Other pressures to draw, by label, each of shape (k, n) [Pa].
        energy: Energy by name [J], positive if used, negative if given, as by pumps.
        energy_title: Title of the energy flow: source of the energy, its sum, and its saving.
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
    energy_title: str

    @property
    def tip(self) -> FloatArray:
        """Tip positions (x, z) in the arm's plane, shape (k, 2) [m]."""
        return self.machine.tip_positions(self.position)

    @property
    def duration(self) -> float:
        """Time from the first instant to the last [s]."""
        return float(self.time[-1] - self.time[0])

    @property
    def heading(self) -> str:
        """Title with the duration, and with the rest at the end if it is noticeable."""
        rest = f", the last {self.rest:.1f} s at rest" if self.rest > SHOWN_REST else ""
        return f"{self.title}: {self.duration:.2f} s{rest}"

    @property
    def rest(self) -> float:
        """Time at the end in which the reference rests, or the positions if there is none [s]."""
        followed = self.position if self.reference is None else self.reference
        away = np.any(np.abs(followed - followed[-1]) > REST_TOLERANCE, axis=1)
        return float(self.time[-1] - np.max(self.time[away], initial=self.time[0]))


def move_of_plan(machine: Machine, plan: Plan, goal: Position, title: str) -> MoveRecord:
    """Convert a planned motion to a record, with static forces, planned pressures and energy.

    Args:
        machine: The arm for which the plan was made.
        plan: The plan; its motion is sampled at `SAMPLE_COUNT` instants, evenly spaced in time.
        goal: Goal in `base_link` [m].
        title: Title of the picture.

    Returns:
        The record; time 0 is the beginning of the motion. `reference` is None. `chambers` has the
        load pressures p_L (supply pressures that the loads need), because a plan has no chamber
        pressures. It also has the sum of p_L, valve drop and boost margin, which decides on boost.
    """
    trajectory, schedule = plan.motion.trajectory, plan.motion.schedule
    offset_ns = np.linspace(0, trajectory.duration_ns, SAMPLE_COUNT).astype(np.int64)
    time_ns = trajectory.stamp_ns + offset_ns
    position, velocity, _ = trajectory.sample_many(time_ns)
    modes = schedule.modes_at_many(time_ns)
    profile = compute_motion_profile(machine, position, velocity)
    return MoveRecord(
        machine=machine,
        title=title,
        goals=(goal,),
        time=offset_ns / SECOND_NS,
        position=position,
        reference=None,
        modes=modes,
        speed=profile.speed,
        force=profile.force,
        supply=compute_planned_supply(machine, profile.force, profile.speed, modes),
        chambers={
            "needed: $p_L$, valve, margin": compute_required_pressures(
                machine.arrays,
                profile.force,
                np.where(np.abs(profile.speed) > MAX_HELD_SPEED, profile.speed, 0.0),
            ),
            "the load's, $p_L$": load_pressures(machine, profile.force, profile.speed),
        },
        energy=split_energy(plan.energy),
        energy_title="energy by the planner's model, with the pumps in series:\n"
        + compute_single_supply(machine, trajectory).describe_saving(plan.energy.series),
    )


def load_pressures(machine: Machine, force: FloatArray, speed: FloatArray) -> FloatArray:
    """Compute the load pressure p_L (supply pressure that the load needs) of each actuator.

    It depends on the direction of motion. At speeds up to MAX_HELD_SPEED, the actuator counts as at
    rest, and the direction against its load is taken.

    Args:
        machine: The arm.
        force: Piston forces, positive if the load resists extension, shape (k, n) [N].
        speed: Piston speeds, positive extending, shape (k, n) [m/s].

    Returns:
        Load pressures [Pa], shape (k, n).
    """
    m, tank = machine.arrays, machine.arrays.tank_pressure
    direction = np.where(np.abs(speed) > MAX_HELD_SPEED, speed, force)
    return np.array([
        [
            load_pressure(m.cap_area[j], m.rod_area[j], tank, force[k, j], direction[k, j])
            for j in range(machine.joint_count)
        ]
        for k in range(len(force))
    ])  # fmt: skip


def split_energy(energy: Energy) -> dict[str, float]:
    """Split the energy of a motion into parts for the energy flow diagram.

    Args:
        energy: Energy of the motion by the planner's model. Its parts for servo pumps in series
            with the main pump are used.

    Returns:
        Energy by name [J], negative for the pumps, which give energy. The names are `main pump`,
        `servo pumps`, `work on the loads`, `throttling`, `leakage`, `oil to the tank` and `servo
        pump losses`.
    """
    return {
        "main pump": -energy.main_pump,
        "servo pumps": -energy.servo_pumps,
        "work on the loads": energy.piston_work,
        "throttling": energy.servo_valves,
        "leakage": energy.leakage,
        "oil to the tank": energy.return_oil,
        "servo pump losses": energy.servo_pump_losses,
    }
