"""Loads that no boost carries: while its cylinder rests, the closed valve alone holds them.

The search never lifts such a load, but it may begin with one, lower it, or let a cylinder rest
under it while others move. The highest boost is asked for there all the same, since it leaves
least for the valve to hold; the servo can correct downwards only, and the load may sag.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.hydraulics import required_pressure, required_pressures
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray
from mhsb_planner.motion.motion_profile import MotionProfile
from mhsb_planner.motion.s3_limits import DEAD_BAND


@dataclass(frozen=True)
class Overload:
    """An actuator's rests under loads beyond the highest boost pressure.

    actuator  name
    duration  s, of all these rests
    pressure  Pa, the most that holding the load would take, margin included
    highest   Pa, what boost gives
    at_end    whether the motion ends with such a rest
    """

    actuator: str
    duration: float
    pressure: float
    highest: float
    at_end: bool

    def __str__(self) -> str:
        """One sentence."""
        where = " and then at the goal" if self.at_end else ""
        return (
            f"{self.actuator} rests for {self.duration:.2f} s{where} under a load that takes "
            f"{self.pressure / 1e6:.3g} MPa to hold, the highest boost being "
            f"{self.highest / 1e6:.3g} MPa: its closed valve alone holds it"
        )


def overloads(machine: Machine, time: FloatArray, profile: MotionProfile) -> tuple[Overload, ...]:
    """Overloads of a motion with this profile at `time` float64[k] s, one for each actuator."""
    highest = machine.arrays.max_boost_pressure
    if not _are_there_any(machine.arrays, profile.speed, profile.force):
        return ()
    pressure = required_pressures(machine.arrays, profile.force, np.zeros(profile.force.shape))
    resting = (pressure > highest) & (np.abs(profile.speed) <= DEAD_BAND)
    span = np.append(np.diff(time), 0.0)
    return tuple(
        Overload(
            name,
            float(span[resting[:, j]].sum()),
            float(pressure[resting[:, j], j].max()),
            highest,
            bool(resting[-1, j]),
        )
        for j, name in enumerate(machine.actuator_names)
        if resting[:, j].any()
    )


@kernel
def _are_there_any(m: MachineArrays, speed: FloatArray, force: FloatArray) -> bool:
    """Whether a cylinder rests under more than the highest boost can carry."""
    for k in range(len(speed)):
        for j in range(speed.shape[1]):
            rests = abs(speed[k, j]) <= DEAD_BAND
            if rests and required_pressure(m, j, force[k, j], 0.0) > m.max_boost_pressure:
                return True
    return False
