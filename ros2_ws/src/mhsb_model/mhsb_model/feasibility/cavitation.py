"""Loads that drive a piston faster than its inlet chamber fills, so that the chamber cavitates.

A matched servo valve (with equal metering edges) fills the inlet chamber as fast as the other
chamber empties, but only up to a certain load. That load does not depend on the piston speed
(`hydraulics.cavitates`). Pressure compensators limit the drop over each edge. The inlet chamber
then fills as if the supply pressure were this drop, if it is lower. A motion may have loads that
cause cavitation: the anti-cavitation valves then fill the chamber from the tank. The servo is less
stiff during that time.
"""

from dataclasses import dataclass

import numpy as np

from mhsb_model.hydraulics import cavitates
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray


@dataclass(frozen=True)
class Cavitation:
    """Cavitation of one actuator during a motion."""

    actuator: str
    """Name of the actuator."""

    begin: float
    """Time at which the inlet chamber first cavitates [s]."""

    duration: float
    """Total time in which the inlet chamber cavitates [s]."""

    force: float
    """Strongest load that causes cavitation, positive if it resists extension [N]."""

    def __str__(self) -> str:
        """Describe the cavitation in one sentence."""
        return (
            f"the load drives {self.actuator} with up to {abs(self.force):.0f} N from "
            f"{self.begin:.2f} s on, for {self.duration:.2f} s in all: its inlet chamber "
            "cavitates at any speed"
        )


def find_cavitating(
    machine: Machine, force: FloatArray, speed: FloatArray, least_speed: float = 0.0
) -> np.ndarray:
    """Return whether each load empties the inlet chamber of its actuator.

    The supply line is taken to be at the main pump's pressure P_S. Boost is neglected, although it
    would fill the chamber better. With pressure compensators, at most the pressure drop p =
    min(P_S, Δp_k) drives oil into the chamber. Δp_k is the compensators' drop. Compensators also
    limit the flow to the tank. So a retracting piston does not cavitate if Δp_k ≤ p (A/a)², with
    the cap-side area A and the rod-side area a.

    Args:
        machine: Machine with n actuators.
        force: Load on each piston at k instants, positive if it resists extension, shape (k, n)
            [N].
        speed: Piston speeds at these instants, positive if extending, shape (k, n) [m/s].
        least_speed: A piston up to this speed counts as held by its closed valve, and never
            cavitates [m/s].

    Returns:
        True if the load empties the inlet chamber, bool[k, n], aligned with `force`.
    """
    m, largest_drop = machine.arrays, machine.config.hydraulics.valve.largest_drop
    filling = min(m.supply_pressure, largest_drop)
    empty = cavitates(m.cap_area, m.rod_area, filling, m.tank_pressure, force, speed)
    # retracting, a compensated edge to the tank lets no more oil out than the inlet takes
    fills = (speed < 0.0) & (largest_drop <= filling * (m.cap_area / m.rod_area) ** 2)
    return empty & ~fills & (np.abs(speed) > least_speed)


def summarize_cavitation(
    machine: Machine,
    time: FloatArray,
    force: FloatArray,
    speed: FloatArray,
    least_speed: float = 0.0,
) -> tuple[Cavitation, ...]:
    """Summarize for each actuator when and how strongly it cavitates during a motion.

    A chamber cavitates if the load empties it faster than the supply fills it. Each instant stands
    for the time up to the next instant; the last instant stands for 0 s.

    Args:
        machine: Machine with n actuators.
        time: Instants in ascending order, shape (k,) [s].
        force: Load on each piston at these instants, positive if it resists extension, shape (k, n)
            [N].
        speed: Piston speeds at these instants, positive if extending, shape (k, n) [m/s].
        least_speed: A piston up to this speed counts as held by its closed valve, and never
            cavitates [m/s].

    Returns:
        One entry for each actuator that cavitates, in the order of the actuators; empty if none
        does. An entry has the first instant and total duration of cavitation, and the load of
        largest magnitude during cavitation.
    """
    empty = find_cavitating(machine, force, speed, least_speed)
    span = np.append(np.diff(time), 0.0)
    return tuple(
        Cavitation(
            name,
            float(time[np.argmax(empty[:, j])]),
            float(span[empty[:, j]].sum()),
            float(max(force[empty[:, j], j], key=abs)),
        )
        for j, name in enumerate(machine.actuator_names)
        if empty[:, j].any()
    )
