"""Goals at which the arm would be in an obstacle, or nearer to one than paths get."""

from __future__ import annotations

import numpy as np

from mhsb_model.clearance import clearances, tip_clearance
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray, frozen
from mhsb_planner.errors import ZoneError


def check_tip(machine: Machine, x: float, z: float) -> None:
    """Raise ZoneError where the tip at (x, z) m alone is too near to an obstacle."""
    if len(machine.arrays.obstacle) == 0:
        return
    margin = machine.arrays.path_margin
    distance, nearest = tip_clearance(machine.arrays, x, z)
    if distance < margin:
        where = f"{-distance:.4g} m deep in" if distance < 0.0 else f"{distance:.4g} m from"
        raise ZoneError(
            x,
            z,
            f"at ({x:.4g}, {z:.4g}) m the tip is {where} {machine.obstacles.names[nearest]}; "
            f"a goal must leave it {margin:g} m away",
        )


def clear_postures(machine: Machine, x: float, z: float, posture: FloatArray) -> np.ndarray:
    """Which postures float64[count, n] [rad] with the tip at (x, z) m keep clear, bool[count].

    Raises ZoneError where none does.
    """
    m = machine.arrays
    if len(m.obstacle) == 0:
        return np.ones(len(posture), dtype=bool)
    distance, nearest = clearances(m, frozen(posture))
    clear = distance >= m.path_margin
    if not clear.any():
        best = nearest[np.argmax(distance)]
        raise ZoneError(
            x,
            z,
            f"in every posture that this planner takes with the tip at ({x:.4g}, {z:.4g}) m "
            f"the arm is less than {m.path_margin:g} m from an obstacle, at best from "
            f"{machine.obstacles.names[best]}; give another goal",
        )
    return clear


def warm_up(machine: Machine) -> None:
    """Compile the kernels that are needed, whether there are obstacles or not."""
    tip_clearance(machine.arrays, 0.0, 0.0)
    clearances(machine.arrays, frozen(np.zeros((1, machine.joint_count))))
