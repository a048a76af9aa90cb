"""Loads that drive a piston faster than its inlet chamber fills: it runs empty (cavitates).

In a matched valve the driven piston draws in as much as leaves on the other side only up to a load
that does not depend on its speed (`hydraulics.cavitates`). Such loads are no limit of a motion:
the anti-cavitation valves fill the chamber from the tank, and the servo loses stiffness meanwhile.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mhsb_model.hydraulics import cavitates
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray


@dataclass(frozen=True)
class Cavitation:
    """What a motion's loads do to an actuator.

    actuator  name
    begin     s, when its inlet chamber first empties
    duration  s, in which it does, all in all
    force     N, the strongest such load, positive against extension
    """

    actuator: str
    begin: float
    duration: float
    force: float

    def __str__(self) -> str:
        """One sentence."""
        return (
            f"the load drives {self.actuator} with up to {abs(self.force):.0f} N from "
            f"{self.begin:.2f} s on, for {self.duration:.2f} s in all: its inlet chamber "
            "cavitates at any speed"
        )


def cavitating(
    machine: Machine, force: FloatArray, speed: FloatArray, least_speed: float = 0.0
) -> np.ndarray:
    """Where loads empty an inlet chamber, bool[k, n].

    force        float64[k, n] N, positive against extension
    speed        float64[k, n] m/s of the pistons, positive extending
    least_speed  m/s, up to which a piston counts as held by its valve

    The line is at P_S at least: what boost adds fills the chamber all the better and is left out.
    """
    m = machine.arrays
    empty = cavitates(m.cap_area, m.rod_area, m.supply_pressure, m.tank_pressure, force, speed)
    return empty & (np.abs(speed) > least_speed)


def cavitations(
    machine: Machine,
    time: FloatArray,
    force: FloatArray,
    speed: FloatArray,
    least_speed: float = 0.0,
) -> tuple[Cavitation, ...]:
    """Cavitation at the instants `time` float64[k] s, one for each actuator that has any."""
    empty = cavitating(machine, force, speed, least_speed)
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
