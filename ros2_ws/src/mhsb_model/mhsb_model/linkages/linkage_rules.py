"""Within which limits a linkage can be used: every broken rule is one sentence.

The angle range of a joint is looked at on a 0.1° grid.
"""

from __future__ import annotations

import math

import numpy as np

from mhsb_model.linkages import four_bar, linkage
from mhsb_model.schema import AnyJoint, FourBar, MachineConfig, unit_of
from mhsb_model.types import FloatArray

SMALLEST_ARM_RATIO = 0.25
"""A joint's limits must keep its moment arm above this share of the largest one: the velocity
polytope grows without bound as the arm vanishes, and would draw postures there."""

SMALLEST_TRANSMISSION_ANGLE = math.radians(20.0)
"""Least angle between the lines of rocker and coupler: at zero the four-bar locks, and can change
over from one way of being assembled to the other."""


def linkage_problems(config: MachineConfig) -> list[str]:
    """Every rule about linkages and limits that a configuration breaks, as `path: sentence`."""
    problems = []
    for index, joint in enumerate(config.joints):
        if joint.kind == "slew":  # its lever is the same everywhere
            continue
        path = f"joints.{index}"
        assembly = _assembly_problems(path, joint)
        problems += assembly or [*_moment_arm_problems(path, joint), *_stroke_problems(path, joint)]
    return problems


def _assembly_problems(path: str, joint: AnyJoint) -> list[str]:
    """A four-bar must close, well away from where rocker and coupler are in line."""
    if not isinstance(joint.linkage, FourBar):
        return []
    row, angles = linkage.linkage_row(joint.linkage), _angles(joint)
    cosine = four_bar.cos_transmission_angles(row, angles)
    worst = int(np.argmax(np.abs(cosine)))
    at = f"at {angles[worst]:.4g} rad within {_range(joint)}"
    if abs(cosine[worst]) > 1.0:
        a, b = joint.linkage.rocker_length, joint.linkage.coupler_length
        distance = math.sqrt(a * a + b * b - 2.0 * a * b * cosine[worst])
        return [
            f"{path}.linkage: the four-bar cannot be assembled {at}, where rocker pivot and child "
            f"pin are {distance:.4g} m apart and rocker and coupler span {abs(a - b):.4g} … "
            f"{a + b:.4g} m: narrow the limits or change the lengths"
        ]
    angle = math.acos(abs(cosine[worst]))
    if angle < SMALLEST_TRANSMISSION_ANGLE:
        return [
            f"{path}.linkage: rocker and coupler come within {angle:.4g} rad of one line {at}, "
            f"where the four-bar locks; they must stay {SMALLEST_TRANSMISSION_ANGLE:.4g} rad away: "
            "narrow the limits or change the lengths"
        ]
    return []


def _moment_arm_problems(path: str, joint: AnyJoint) -> list[str]:
    row = linkage.linkage_row(joint.linkage)
    least, largest = linkage.moment_arm_range(row, joint.limits.lower, joint.limits.upper)
    weakest = 0.0 if least * largest <= 0 else min(abs(least), abs(largest))
    needed = SMALLEST_ARM_RATIO * max(abs(least), abs(largest))
    if weakest >= needed:
        return []
    return [
        f"{path}.limits: the moment arm falls to {weakest:.4g} m within {_range(joint)}, "
        f"it must stay above {needed:.4g} m: narrow the limits or move the pins"
    ]


def _stroke_problems(path: str, joint: AnyJoint) -> list[str]:
    """The barrel takes in the whole stroke, so a cylinder at most doubles its length."""
    row = linkage.linkage_row(joint.linkage)
    lengths = linkage.motions(row, _angles(joint))[:, 0]
    shortest, longest = lengths.min(), lengths.max()
    if longest < 2.0 * shortest:
        return []
    return [
        f"{path}.linkage: the cylinder goes from {shortest:.4g} m to {longest:.4g} m within "
        f"{_range(joint)}, it must stay below twice its shortest length: "
        "narrow the limits or move the parent pin away"
    ]


def _angles(joint: AnyJoint) -> FloatArray:
    return linkage.angle_grid(joint.limits.lower, joint.limits.upper)


def _range(joint: AnyJoint) -> str:
    return f"[{joint.limits.lower:g}, {joint.limits.upper:g}] {unit_of(joint)}"
