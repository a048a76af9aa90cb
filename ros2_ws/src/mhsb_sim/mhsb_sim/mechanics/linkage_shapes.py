"""Shapes of cylinders and linkages in pictures: barrels, rods, rockers and couplers as bars."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mhsb_model.linkages import four_bar, linkage
from mhsb_model.machine import Machine
from mhsb_model.schema import Direct, FourBar, Motor, Pin, RackAndPinion
from mhsb_model.types import FloatArray

BARREL_SHARE = 0.85
BARREL_RADIUS = 0.016  # m, as all radii of an arm of the paper's size
BARREL_PAINT = (0.16, 0.35, 0.55, 1.0)
ROD_RADIUS = 0.006  # m
ROD_PAINT = (0.80, 0.82, 0.85, 1.0)
BAR_RADIUS = 0.009  # m, of rocker and coupler
ROCKER_PAINT = (0.10, 0.72, 0.45, 1.0)
COUPLER_PAINT = (0.86, 0.40, 0.62, 1.0)
BESIDE = -0.05
"""y of the linkages [m]: next to the links, of no effect in the plane."""


class Bar(NamedTuple):
    """A round bar: both ends float64[3] and radius [m], colour as red, green, blue, opacity."""

    start: FloatArray
    end: FloatArray
    radius: float
    paint: tuple[float, float, float, float]


def linkage_bars(machine: Machine, q: FloatArray) -> list[Bar]:
    """Bars of all linkages in the posture q[n] [rad], actuator by actuator, its barrel last.

    Of what slews there are none.
    """
    bars = bars_in_plane(machine, q)
    return [_slewed(machine, float(q[0]), bar) for bar in bars] if machine.slews else bars


def bars_in_plane(machine: Machine, q: FloatArray) -> list[Bar]:
    """The same, seen from the side where the arm slews."""
    joints, size = machine.joint_positions(q), machine.scale
    angle = np.append(0.0, machine.link_angles(q))  # of the link before each joint, and of the last
    bars = []
    for j, joint in enumerate(machine.config.joints):
        if isinstance(joint.linkage, RackAndPinion | Motor):
            continue
        if isinstance(joint.linkage, Direct):  # along the boom, to the telescope's tip
            rod_end = np.array([joints[j + 1, 0], BESIDE, joints[j + 1, 1]])
            length = joint.linkage.retracted_length + q[j]
            parent_pin = rod_end - _turned(length, 0.0, angle[j])
            bars.append(Bar(parent_pin, rod_end, size * ROD_RADIUS, ROD_PAINT))
            bars.append(_barrel(machine, j, parent_pin, rod_end))
            continue
        parent_pin = _pin(joints[j], angle[j], joint.linkage.parent_pin)
        rod_end = child_pin = _pin(joints[j], angle[j + 1], joint.linkage.child_pin)
        if isinstance(joint.linkage, FourBar):
            pivot = _pin(joints[j], angle[j], joint.linkage.rocker_pivot)
            x, z, *_ = four_bar.motion(machine.arrays.linkage[j], math.cos(q[j]), math.sin(q[j]))
            rod_end = pivot + _turned(x, z, angle[j])
            bars.append(Bar(pivot, rod_end, size * BAR_RADIUS, ROCKER_PAINT))
            bars.append(Bar(rod_end, child_pin, size * BAR_RADIUS, COUPLER_PAINT))
        bars.append(Bar(parent_pin, rod_end, size * ROD_RADIUS, ROD_PAINT))
        bars.append(_barrel(machine, j, parent_pin, rod_end))
    return bars


def _slewed(machine: Machine, angle: float, bar: Bar) -> Bar:
    """A bar in the plane, as it is where joint 1 has turned that plane by an angle [rad]."""
    cosine, sine = np.cos(angle), np.sin(angle)
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    foot = np.array([machine.arrays.slew_offset, 0.0, 0.0])
    start, end = turn @ (bar.start + foot), turn @ (bar.end + foot)
    return bar._replace(start=start, end=end)


def _pin(joint: FloatArray, angle: float, pin: Pin) -> FloatArray:
    """Place of a pin in a link that goes through a joint (x, z) [m] at an angle [rad]."""
    beside = np.array([joint[0], BESIDE, joint[1]])
    return beside + _turned(pin.radius * np.cos(pin.angle), pin.radius * np.sin(pin.angle), angle)


def _turned(x: float, z: float, angle: float) -> FloatArray:
    """(x, 0, z) turned upwards by an angle [rad]."""
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([cosine * x - sine * z, 0.0, sine * x + cosine * z])


def _barrel(machine: Machine, j: int, parent_pin: FloatArray, rod_end: FloatArray) -> Bar:
    """From the parent pin, as long as the rod lets it be."""
    lengths = [
        linkage.cylinder_length(machine.arrays.linkage[j], q)
        for q in (machine.arrays.joint_min[j], machine.arrays.joint_max[j])
    ]
    along = (rod_end - parent_pin) / np.linalg.norm(rod_end - parent_pin)
    end = parent_pin + BARREL_SHARE * min(lengths) * along
    return Bar(parent_pin, end, machine.scale * BARREL_RADIUS, BARREL_PAINT)
