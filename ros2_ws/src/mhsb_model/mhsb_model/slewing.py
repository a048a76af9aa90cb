"""Conversion of positions between `base_link` and the plane that joint 1 of a slewing arm turns.

`base_link` has its origin on the slew's axis at the height of joint 2, with x forward, y to the
left and z up. With the slew's angle θ and the distance a of joint 2 ahead of the axis, the plane's
position (x', z') is

    x = (a + x') cos θ,  y = (a + x') sin θ,  z = z'

For an arm that does not slew, positions in the plane and in `base_link` are the same (x, z).
"""

import math
from typing import NamedTuple

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.errors import OutOfWorkspaceError
from mhsb_model.types import FloatArray, Position

WHOLE_TURN = 2.0 * math.pi
"""One turn [rad]."""
ANGLE_TOLERANCE = 1e-9
"""Tolerance of angles [rad], and of the distance [m] at which a position lies on the slew's
axis."""


class PlanarTarget(NamedTuple):
    """A position in the arm's plane, and the slew angle at which the plane contains it."""

    tip: tuple[float, float]
    """Position (x', z') in the plane [m]."""
    slew: float | None
    """Angle of the slew [rad]; None if the arm does not slew."""


def convert_to_plane(m: MachineArrays, position: Position, preferred_slew: float) -> PlanarTarget:
    """Convert a position in `base_link` into the arm's plane, and find the slew angle for it.

    A slewing arm moves in a vertical plane that its joint 1 turns. Positions in the plane have
    their origin at joint 2. At the slew angle, the arm faces the position, and need not reach
    behind the slew's axis.

    Args:
        m: Arrays of the machine.
        position: (x, z), or (x, y, z) if joint 1 slews [m].
        preferred_slew: Preferred angle of the slew [rad]. Angles at which the arm faces the
            position differ by whole turns; the nearest within the limits is taken. If the position
            is on the slew's axis, `preferred_slew` is returned.

    Returns:
        Position in the plane, and the slew's angle. If the arm does not slew, the position is
        unchanged and the angle is None.

    Raises:
        OutOfWorkspaceError: No angle within the slew's limits points to the position.
    """
    if not m.slews:
        x, z = position
        return PlanarTarget((x, z), None)
    x, y, z = position
    distance = math.hypot(x, y)
    tip = (distance - m.slew_offset, z)
    if distance < ANGLE_TOLERANCE:
        return PlanarTarget(tip, preferred_slew)
    low, high, angle = float(m.joint_min[0]), float(m.joint_max[0]), math.atan2(y, x)
    turns = math.ceil((low - ANGLE_TOLERANCE - angle) / WHOLE_TURN)
    angles = np.arange(angle + turns * WHOLE_TURN, high + ANGLE_TOLERANCE, WHOLE_TURN)
    if len(angles) == 0:
        raise OutOfWorkspaceError(
            position,
            f"joint 1 would have to slew to {angle:.4g} rad, within {low:.4g} … {high:.4g} rad it "
            "can",
        )
    nearest = float(angles[np.argmin(np.abs(angles - preferred_slew))])
    return PlanarTarget(tip, min(high, max(low, nearest)))


def project_to_plane(m: MachineArrays, position: FloatArray) -> FloatArray:
    """Convert positions in `base_link` into the arm's plane.

    A slewing arm moves in a vertical plane that its joint 1 turns. For each position, the plane is
    turned towards it. The slew's angle is not computed, and its limits are not checked.

    Args:
        m: Arrays of the machine.
        position: (x, z), or (x, y, z) if joint 1 slews, shape (…, 2 or 3) [m].

    Returns:
        Horizontal distance x' from joint 2 and height z' above the origin of `base_link`, shape
        (…, 2) [m]. The input itself if the arm does not slew.
    """
    if not m.slews:
        return position
    distance = np.hypot(position[..., 0], position[..., 1])
    return np.stack([distance - m.slew_offset, position[..., 2]], axis=-1)


def convert_to_base(m: MachineArrays, tip: FloatArray, slew: FloatArray) -> FloatArray:
    """Convert positions in the arm's plane into `base_link`.

    A slewing arm moves in a vertical plane that its joint 1 turns. Positions in the plane have
    their origin at joint 2.

    Args:
        m: Arrays of the machine.
        tip: Positions (x', z') in the plane, shape (…, 2) [m].
        slew: Angle of the slew for each position, shape (…) [rad]; ignored if the arm does not
            slew.

    Returns:
        (x, y, z), shape (…, 3) [m]. If the arm does not slew, the input itself, shape (…, 2).
    """
    if not m.slews:
        return tip
    distance = m.slew_offset + tip[..., 0]
    return np.stack([distance * np.cos(slew), distance * np.sin(slew), tip[..., 1]], axis=-1)
