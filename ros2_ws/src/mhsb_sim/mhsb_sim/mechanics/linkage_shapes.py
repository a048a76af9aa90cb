"""Shapes of cylinders and linkages in pictures: barrels, rods, rockers and couplers as bars."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from mhsb_model.linkages import four_bar, linkage
from mhsb_model.machine import Machine
from mhsb_model.schema import FourBar
from mhsb_model.types import FloatArray

BARREL_SHARE = 0.85
BARREL_RADIUS = 0.016  # m
BARREL_PAINT = (0.16, 0.35, 0.55, 1.0)
ROD_RADIUS = 0.006  # m
ROD_PAINT = (0.80, 0.82, 0.85, 1.0)
BAR_RADIUS = 0.009  # m, of rocker and coupler
ROCKER_PAINT = (0.10, 0.72, 0.45, 1.0)
COUPLER_PAINT = (0.86, 0.40, 0.62, 1.0)


class Bar(NamedTuple):
    """A round bar: both ends float64[3] and radius [m], colour as red, green, blue, opacity."""

    start: FloatArray
    end: FloatArray
    radius: float
    paint: tuple[float, float, float, float]


def linkage_bars(machine: Machine, data: Any) -> list[Bar]:
    """Bars of all linkages in the posture of a MuJoCo state of `build_model(machine)`."""
    bars = []
    for j, name in enumerate(machine.actuator_names):
        parent_pin = data.site(f"{name}_parent_pin").xpos.copy()
        rod_end = child_pin = data.site(f"{name}_child_pin").xpos.copy()
        if isinstance(machine.config.joints[j].linkage, FourBar):
            pivot = data.site(f"{name}_rocker_pivot").xpos.copy()
            frame = data.site(f"{name}_rocker_pivot").xmat.reshape(3, 3)
            q = data.qpos[j]
            x, z, *_ = four_bar.motion(machine.arrays.linkage[j], math.cos(q), math.sin(q))
            rod_end = pivot + frame @ np.array([x, 0.0, z])
            bars.append(Bar(pivot, rod_end, BAR_RADIUS, ROCKER_PAINT))
            bars.append(Bar(rod_end, child_pin, BAR_RADIUS, COUPLER_PAINT))
        bars.append(Bar(parent_pin, rod_end, ROD_RADIUS, ROD_PAINT))
        bars.append(_barrel(machine, j, parent_pin, rod_end))
    return bars


def _barrel(machine: Machine, j: int, parent_pin: FloatArray, rod_end: FloatArray) -> Bar:
    """From the parent pin, as long as the rod lets it be."""
    lengths = [
        linkage.cylinder_length(machine.arrays.linkage[j], q)
        for q in (machine.arrays.joint_min[j], machine.arrays.joint_max[j])
    ]
    along = (rod_end - parent_pin) / np.linalg.norm(rod_end - parent_pin)
    end = parent_pin + BARREL_SHARE * min(lengths) * along
    return Bar(parent_pin, end, BARREL_RADIUS, BARREL_PAINT)
