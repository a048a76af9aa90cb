"""Rules that a linkage must keep within its joint's limits; every broken rule is one sentence.

Linkages are evaluated on a 0.1° grid of the joint angle.
"""

import math
from collections.abc import Iterator
from functools import lru_cache

import numpy as np

from mhsb_model.linkages import four_bar, linkage
from mhsb_model.schema import AnyJoint, FourBar, MachineConfig, SliderCrank, unit_of
from mhsb_model.types import FloatArray

SMALLEST_ARM_RATIO = 0.25
"""Least ratio of the smallest to the largest moment arm within a joint's limits.

As the moment arm vanishes, the velocity polytope grows without bound. Planners would then prefer
such postures."""

SMALLEST_TRANSMISSION_ANGLE = math.radians(20.0)
"""Least angle between the lines of rocker and coupler [rad].

At zero the four-bar locks and can change from one assembly mode to the other."""


def check_linkages(config: MachineConfig) -> Iterator[str]:
    """Check the linkages of all joints against the rules for assembly, moment arm and stroke.

    The rules must hold within each joint's limits. If a linkage cannot be assembled, its moment arm
    and stroke are not checked. Slews have no rules.

    Args:
        config: Content of a machine file.

    Yields:
        One string `path: sentence` for each broken rule.
    """
    for index, joint in enumerate(config.joints):
        if joint.kind == "slew":  # its moment arm is constant
            continue
        yield from _check_joint(f"joints.{index}", joint)


@lru_cache(maxsize=64)
def _check_joint(path: str, joint: AnyJoint) -> list[str]:
    """Check the linkage of a joint. Copies of a machine with other values have the same joints.

    Args:
        path: Path of the joint in the file, such as `joints.0`.
        joint: Joint section of the file.

    Returns:
        One string `path: sentence` for each broken rule. The list must not be changed.
    """
    return _check_assembly(path, joint) or [
        *_check_moment_arm(path, joint),
        *_check_stroke(path, joint),
    ]


def _check_assembly(path: str, joint: AnyJoint) -> list[str]:
    """Check that a four-bar can be assembled and stays away from its locking position.

    The four-bar locks if rocker and coupler are in one line. The angle between their lines must be
    at least SMALLEST_TRANSMISSION_ANGLE for all joint angles of a grid between the limits. Only the
    joint angle with the worst value is reported. Other kinds of linkages have no such rule.

    Args:
        path: Path of the joint in the file, such as `joints.0`.
        joint: Joint section of the file.

    Returns:
        One string `path: sentence` if the rule is broken, else an empty list.
    """
    if not isinstance(joint.linkage, FourBar):
        return []
    row, angles = linkage.build_linkage_row(joint.linkage), _list_angles_within_limits(joint)
    cosine = np.array([four_bar.cos_transmission_angle(row, q) for q in angles])
    worst = int(np.argmax(np.abs(cosine)))
    at = f"at {angles[worst]:.4g} rad within {_format_limits(joint)}"
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


def _check_moment_arm(path: str, joint: AnyJoint) -> list[str]:
    """Check that the moment arm keeps its sign and does not become too small.

    Within the joint's limits, its smallest magnitude must be at least SMALLEST_ARM_RATIO times its
    largest.

    Args:
        path: Path of the joint in the file, such as `joints.0`.
        joint: Joint section of the file.

    Returns:
        One string `path: sentence` if the rule is broken, else an empty list.
    """
    weakest, needed = _compute_arm_and_need(joint)
    if weakest >= needed:
        return []
    return [
        f"{path}.limits: the moment arm falls to {weakest:.4g} m within {_format_limits(joint)}, "
        f"it must stay above {needed:.4g} m: narrow the limits or move the pins"
        f"{_suggest_limits(joint)}{_suggest_angle(joint)}"
    ]


def _compute_arm_and_need(joint: AnyJoint) -> tuple[float, float]:
    """Compute the smallest moment arm of a joint within its limits, and how large it must be.

    Args:
        joint: Joint section of the file.

    Returns:
        Smallest magnitude of the moment arm, 0 if its sign changes, and the least allowed one [m].
    """
    row = linkage.build_linkage_row(joint.linkage)
    least, largest = linkage.moment_arm_range(row, joint.limits.lower, joint.limits.upper)
    weakest = 0.0 if least * largest <= 0 else min(abs(least), abs(largest))
    return weakest, SMALLEST_ARM_RATIO * max(abs(least), abs(largest))


def _find_usable_range(row: FloatArray, lower: float, upper: float) -> tuple[float, float]:
    """Find the joint angles around the largest moment arm at which the arm is still large enough.

    Args:
        row: Numbers of the linkage, from `build_linkage_row`.
        lower: Lower end of the range that is searched [rad].
        upper: Upper end of that range [rad].

    Returns:
        Ends of the range in which the moment arm keeps its sign and is at least SMALLEST_ARM_RATIO
        times its largest value [rad].
    """
    angles = linkage.angle_grid(lower, upper)
    arms = linkage.evaluate_linkage_at_angles(row, angles)[:, 1]
    peak = int(np.argmax(np.abs(arms)))
    weak = np.flatnonzero(arms / arms[peak] < SMALLEST_ARM_RATIO)
    first = weak[weak < peak].max(initial=-1) + 1
    last = weak[weak > peak].min(initial=len(angles)) - 1
    return float(angles[first]), float(angles[last])


def _suggest_limits(joint: AnyJoint) -> str:
    """Return a clause with limits that the joint's pins allow, within the limits of the file [rad].

    Args:
        joint: Joint section of the file.

    Returns:
        The clause, with numbers rounded inwards to 1 mrad; empty if rounding leaves no range.
    """
    row = linkage.build_linkage_row(joint.linkage)
    low, high = _find_usable_range(row, joint.limits.lower, joint.limits.upper)
    low, high = (rounded(1e3 * q) / 1e3 for rounded, q in ((math.ceil, low), (math.floor, high)))
    if low >= high:
        return ""
    return f"; with these pins [{low:g}, {high:g}] rad is possible"


def _suggest_angle(joint: AnyJoint) -> str:
    """Return a clause with the angle of a slider-crank's child pin that allows a joint's limits.

    With this angle, the middle of the joint's limits is the middle of the range in which the moment
    arm is large enough. The moment arm keeps the sign that its largest value has.

    Args:
        joint: Joint section of the file.

    Returns:
        The clause; empty for other linkages, or if this angle breaks the rule for the moment arm or
        for the stroke.
    """
    crank, limits = joint.linkage, joint.limits
    if not isinstance(crank, SliderCrank):
        return ""
    pins = [pin.model_copy(update={"angle": 0.0}) for pin in (crank.parent_pin, crank.child_pin)]
    in_line = crank.model_copy(update=dict(zip(("parent_pin", "child_pin"), pins, strict=True)))
    between = sum(_find_usable_range(linkage.build_linkage_row(in_line), 0.0, math.pi)) / 2.0
    arms = linkage.moment_arm_range(linkage.build_linkage_row(crank), limits.lower, limits.upper)
    turned = math.copysign(between, sum(arms)) - 0.5 * (limits.lower + limits.upper)
    angle = round(math.remainder(crank.parent_pin.angle + turned, 2.0 * math.pi), 3)
    child_pin = crank.child_pin.model_copy(update={"angle": angle})
    changed = crank.model_copy(update={"child_pin": child_pin})
    other = joint.model_copy(update={"linkage": changed})
    weakest, needed = _compute_arm_and_need(other)
    if weakest >= needed and not _check_stroke("", other):
        return f"; child_pin.angle {angle:g} rad allows these limits"
    return ""


def _check_stroke(path: str, joint: AnyJoint) -> list[str]:
    """Check that the cylinder always stays shorter than twice its shortest length.

    The barrel of a cylinder holds the whole stroke, so the length can at most double. Lengths are
    computed on a grid of positions between the joint's limits.

    Args:
        path: Path of the joint in the file, such as `joints.0`.
        joint: Joint section of the file.

    Returns:
        One string `path: sentence` if the rule is broken within the joint's limits, else an empty
        list.
    """
    row = linkage.build_linkage_row(joint.linkage)
    lengths = linkage.evaluate_linkage_at_angles(row, _list_angles_within_limits(joint))[:, 0]
    shortest, longest = lengths.min(), lengths.max()
    if longest < 2.0 * shortest:
        return []
    return [
        f"{path}.linkage: the cylinder goes from {shortest:.4g} m to {longest:.4g} m within "
        f"{_format_limits(joint)}, it must stay below twice its shortest length: "
        "narrow the limits or move the parent pin away"
    ]


def _list_angles_within_limits(joint: AnyJoint) -> FloatArray:
    """Return the grid of joint angles between a joint's limits."""
    return linkage.angle_grid(joint.limits.lower, joint.limits.upper)


def _format_limits(joint: AnyJoint) -> str:
    """Format a joint's limits with their unit, such as `[-1, 2] rad`."""
    return f"[{joint.limits.lower:g}, {joint.limits.upper:g}] {unit_of(joint)}"
