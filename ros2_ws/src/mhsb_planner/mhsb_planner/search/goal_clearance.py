"""Goals at which the arm would be in an obstacle or nearer to one than paths get; starts in one."""

from __future__ import annotations

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.obstacles.clearance import (
    clearances,
    tip_clearance,
    tip_clearance_in_space,
)
from mhsb_model.obstacles.zones import Zones
from mhsb_model.types import FloatArray, Position, frozen
from mhsb_planner.errors import ZoneError, place_text

TOUCHING = 5e-4
"""Clearance up to which the arm touches an obstacle [m]; motions that keep clear stay away."""


def start_in(machine: Machine, posture: FloatArray) -> str:
    """What obstacle the arm is in or touches in a posture [rad], as a clause; else nothing.

    Zones can be set over an arm, which may leave them.
    """
    clearance, name = machine.clearance(posture)
    if clearance > TOUCHING:
        return ""
    return f"the arm starts {-clearance:.4g} m deep in {name}" if clearance < -TOUCHING else (
        f"the arm touches {name} at the start"
    )


def check_tip(machine: Machine, goal: Position) -> None:
    """Raise ZoneError where the tip alone at a goal in `base_link` is too near to an obstacle."""
    rows, margin = machine.obstacles.path_rows, machine.config.keep_out.margin
    if len(rows) == 0:
        return
    n = machine.joint_count
    beyond, nearest = tip_clearance(rows, n, *machine.in_plane(goal, 0.0).tip)
    if machine.slews:
        x, y, z = goal
        in_space = tip_clearance_in_space(rows, n, x, y, z)
        beyond, nearest = min((beyond, nearest), in_space)
    if beyond < 0.0:
        distance = beyond + margin
        where = f"{-distance:.4g} m deep in" if distance < 0.0 else f"{distance:.4g} m from"
        raise ZoneError(
            goal,
            f"at {place_text(goal)} the tip is {where} {machine.obstacles.name(nearest)}; "
            f"a goal must leave it {margin:g} m away",
        )


def clear_postures(machine: Machine, x: float, z: float, posture: FloatArray) -> np.ndarray:
    """Which postures float64[count, n] [rad] with the tip at (x, z) m keep clear, bool[count].

    Raises ZoneError where none does.
    """
    rows = machine.obstacles.path_rows
    if len(rows) == 0:
        return np.ones(len(posture), dtype=bool)
    distance, nearest = clearances(machine.arrays, rows, frozen(posture))
    clear = distance >= 0.0
    if not clear.any():
        best = nearest[np.argmax(distance)]
        raise ZoneError(
            (x, z),
            f"in every posture that this planner takes with the tip at ({x:.4g}, {z:.4g}) m "
            f"the arm is less than {machine.config.keep_out.margin:g} m from an obstacle, at best "
            f"from {machine.obstacles.name(best)}; give another goal",
        )
    return clear


def warm_up(machine: Machine) -> None:
    """Compile the kernels that are needed, whether there are obstacles or not."""
    rows, n = machine.obstacles.path_rows, machine.joint_count
    tip_clearance(rows, n, 0.0, 0.0)
    tip_clearance_in_space(rows, n, 0.0, 0.0, 0.0)
    clearances(machine.arrays, rows, frozen(np.zeros((1, n))))
    machine.changed(zones=Zones(circles=((0.5, 0.5, 0.01),)))  # whose place is checked
