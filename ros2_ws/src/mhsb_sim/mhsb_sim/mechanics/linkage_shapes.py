"""Shapes of cylinders and linkages in pictures: barrels, rods, rockers and couplers as bars."""

import math
from typing import NamedTuple

import numpy as np

from mhsb_model.linkages import four_bar, linkage
from mhsb_model.machine import Machine
from mhsb_model.schema import Direct, FourBar, Motor, Pin, RackAndPinion
from mhsb_model.types import FloatArray

BARREL_SHARE = 0.85
"""Length of a barrel, as a share of the shortest cylinder length at a joint limit."""
BARREL_RADIUS = 0.016  # [m] for an arm of the paper's size, like all radii here
BARREL_PAINT = (0.16, 0.35, 0.55, 1.0)
ROD_RADIUS = 0.006  # [m]
ROD_PAINT = (0.80, 0.82, 0.85, 1.0)
BAR_RADIUS = 0.009  # [m] rocker and coupler
ROCKER_PAINT = (0.10, 0.72, 0.45, 1.0)
COUPLER_PAINT = (0.86, 0.40, 0.62, 1.0)
LINKAGE_OFFSET = -0.05
"""y coordinate of the linkages [m]: beside the links, without effect on the planar motion."""


class Bar(NamedTuple):
    """A round bar of a picture.

    Attributes:
        start: One end (x, y, z), float64[3], [m].
        end: Other end, float64[3], [m].
        radius: Radius [m].
        color: Colour as red, green, blue and opacity, each 0 … 1.
    """

    start: FloatArray
    end: FloatArray
    radius: float
    color: tuple[float, float, float, float]


def compute_planar_bars(machine: Machine, q: FloatArray) -> list[Bar]:
    """Compute the round bars of all linkages in the arm's own plane, before it is slewed.

    The bars lie at y = LINKAGE_OFFSET, beside the links. Motors and rack-and-pinion drives have no
    bars.

    Args:
        machine: The machine.
        q: Joint positions, float64[n], [rad or m].

    Returns:
        Bars with x forward and z up in the arm's plane, in the order of the actuators. The last bar
        of each actuator is the barrel of its cylinder.
    """
    joints, size = machine.joint_positions(q), machine.relative_size
    # angle[j] is that of the link before joint j, angle[j + 1] that of the link after it.
    angle = np.append(0.0, machine.link_angles(q))
    bars = []
    for j, joint in enumerate(machine.config.joints):
        if isinstance(joint.linkage, RackAndPinion | Motor):
            continue
        if isinstance(joint.linkage, Direct):  # along the boom, to the telescope's tip
            rod_end = np.array([joints[j + 1, 0], LINKAGE_OFFSET, joints[j + 1, 1]])
            length = joint.linkage.retracted_length + q[j]
            parent_pin = rod_end - _rotate_in_plane(length, 0.0, angle[j])
        else:
            parent_pin = _compute_pin_position(joints[j], angle[j], joint.linkage.parent_pin)
            rod_end = child_pin = _compute_pin_position(
                joints[j], angle[j + 1], joint.linkage.child_pin
            )
        if isinstance(joint.linkage, FourBar):
            pivot = _compute_pin_position(joints[j], angle[j], joint.linkage.rocker_pivot)
            x, z, *_ = four_bar.evaluate_four_bar(
                machine.arrays.linkage[j], math.cos(q[j]), math.sin(q[j])
            )
            rod_end = pivot + _rotate_in_plane(x, z, angle[j])
            bars.append(Bar(pivot, rod_end, size * BAR_RADIUS, ROCKER_PAINT))
            bars.append(Bar(rod_end, child_pin, size * BAR_RADIUS, COUPLER_PAINT))
        bars.append(Bar(parent_pin, rod_end, size * ROD_RADIUS, ROD_PAINT))
        bars.append(_build_barrel(machine, j, parent_pin, rod_end))
    return bars


def _compute_pin_position(joint: FloatArray, angle: float, pin: Pin) -> FloatArray:
    """Compute the position of a pin of a link in the arm's plane.

    Args:
        joint: Position (x, z) of the joint at the link's origin [m].
        angle: Angle of the link above the horizontal [rad].
        pin: Polar coordinates of the pin in the link: radius [m] and angle [rad].

    Returns:
        Position (x, y, z) with y = LINKAGE_OFFSET [m].
    """
    beside = np.array([joint[0], LINKAGE_OFFSET, joint[1]])
    return beside + _rotate_in_plane(
        pin.radius * np.cos(pin.angle), pin.radius * np.sin(pin.angle), angle
    )


def _rotate_in_plane(x: float, z: float, angle: float) -> FloatArray:
    """Return (x, 0, z) turned upwards by an angle [rad] about the y axis."""
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([cosine * x - sine * z, 0.0, sine * x + cosine * z])


def _build_barrel(machine: Machine, j: int, parent_pin: FloatArray, rod_end: FloatArray) -> Bar:
    """Build the barrel of a cylinder, from the parent pin towards the rod's end.

    The barrel's length is BARREL_SHARE times the shorter of the cylinder's two lengths at the joint
    limits.

    Args:
        machine: The machine.
        j: Index of the actuator.
        parent_pin: Position of the pin on the link before, float64[3], [m].
        rod_end: Position of the rod's end, float64[3], [m].

    Returns:
        The barrel as a bar.
    """
    lengths = [
        linkage.cylinder_length(machine.arrays.linkage[j], q)
        for q in (machine.arrays.joint_min[j], machine.arrays.joint_max[j])
    ]
    along = (rod_end - parent_pin) / np.linalg.norm(rod_end - parent_pin)
    end = parent_pin + BARREL_SHARE * min(lengths) * along
    return Bar(parent_pin, end, machine.relative_size * BARREL_RADIUS, BARREL_PAINT)
