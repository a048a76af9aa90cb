"""Overloads: loads that even the highest boost pressure cannot hold.

At rest, the closed valve alone holds such a load. The search never lifts an overload. But a motion
may begin with an overload, lower it, or let a cylinder rest under it while others move. The highest
boost pressure is then commanded, because it leaves the smallest pressure difference over the closed
valve. The servo can only lower the load, which may also sag.
"""

from dataclasses import dataclass

import numpy as np

from mhsb_model.holding import MAX_HELD_SPEED
from mhsb_model.hydraulics import (
    compute_required_pressures,
    compute_sinking_speed,
)
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray
from mhsb_planner.motion.motion_profile import MotionProfile


@dataclass(frozen=True)
class Overload:
    """Periods in which an actuator rests under a load that the highest boost pressure cannot hold.

    Attributes:
        actuator: Name of the actuator.
        duration: Total duration of these periods [s].
        pressure: Greatest supply pressure that would be needed to hold the load, with the boost
            margin [Pa].
        highest: Highest boost pressure [Pa].
        at_end: True if the motion ends in such a period.
        sinking_speed: Greatest speed at which the load sinks because the closed valve leaks [m/s].
            0 if the valve does not leak, or if lock valves hold the load.
    """

    actuator: str
    duration: float
    pressure: float
    highest: float
    at_end: bool
    sinking_speed: float = 0.0

    def __str__(self) -> str:
        """Return one sentence that describes the overload."""
        where = " and then at the goal" if self.at_end else ""
        sinks = f", sinking by {6e4 * self.sinking_speed:.3g} mm/min" if self.sinking_speed else ""
        return (
            f"{self.actuator} rests for {self.duration:.2f} s{where} under a load that takes "
            f"{self.pressure / 1e6:.3g} MPa to hold, the highest boost being "
            f"{self.highest / 1e6:.3g} MPa: its closed valve alone holds it{sinks}"
        )


def find_overloads(
    machine: Machine, time: FloatArray, profile: MotionProfile
) -> tuple[Overload, ...]:
    """Find the actuators that rest under a load too heavy for the highest boost pressure.

    Only the closed valve holds such a load. A cylinder rests if its speed is at most
    MAX_HELD_SPEED. The time from a resting instant to the next instant counts as rest.

    Args:
        machine: Machine with its hydraulics.
        time: Instants of the profile in ascending order, shape (k,) [s].
        profile: Profile of the motion (piston speeds and forces) with k rows.

    Returns:
        One entry for each such actuator, with the total duration of its rests [s] and the greatest
        supply pressure that its load needs [Pa]; empty if there is none.
    """
    highest = machine.arrays.max_boost_pressure
    pressure = compute_required_pressures(
        machine.arrays, profile.force, np.zeros(profile.force.shape)
    )
    resting = (pressure > highest) & (np.abs(profile.speed) <= MAX_HELD_SPEED)
    span = np.append(np.diff(time), 0.0)
    return tuple(
        Overload(
            name,
            float(span[resting[:, j]].sum()),
            float(pressure[resting[:, j], j].max()),
            highest,
            bool(resting[-1, j]),
            _find_sinking_speed(machine, j, profile.force[resting[:, j], j]),
        )
        for j, name in enumerate(machine.actuator_names)
        if resting[:, j].any()
    )


def _find_sinking_speed(machine: Machine, j: int, forces: FloatArray) -> float:
    """Find the greatest speed at which loads sink because the closed valve leaks.

    The supply pressure of the valve is assumed to be the highest boost pressure.

    Args:
        machine: Machine with its hydraulics.
        j: Index of the actuator.
        forces: Piston forces, positive if they resist extension, shape (k,) [N]; k ≥ 1.

    Returns:
        Magnitude of the speed [m/s]. 0 if the valve does not leak, or if lock valves hold the
        loads.
    """
    m = machine.arrays
    if machine.config.circuit.lock_valve_opening > 0.0:
        return 0.0
    return max(abs(compute_sinking_speed(m, j, f, m.max_boost_pressure)) for f in forces.tolist())
