"""Arms that slew: between positions in `base_link` and in the plane that joint 1 turns.

`base_link` has its origin on the slew's axis at the height of joint 2, x forward, y to the left and
z up. With the slew's angle θ and joint 2 at the distance a ahead of the axis, the plane's position
(x', z') is that of

    x = (a + x') cos θ,  y = (a + x') sin θ,  z = z'

Arms that do not slew have but their plane: their positions in it and in `base_link` are the same
(x, z).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.errors import OutOfWorkspaceError
from mhsb_model.types import FloatArray, Position

WHOLE_TURN = 2.0 * math.pi
ROUNDING = 1e-9  # rad


class InPlane(NamedTuple):
    """A position (x', z') [m] in the arm's plane, and the angle [rad] of the slew that turns it
    there; None where the arm does not slew."""

    tip: tuple[float, float]
    slew: float | None


def in_plane(m: MachineArrays, position: Position, near: float) -> InPlane:
    """Where a position in `base_link` lies in the arm's plane.

    Of the slew's angles within its limits the nearest to `near` [rad]; on the axis that itself.
    Raises OutOfWorkspaceError where there is none.
    """
    if not m.slews:
        x, z = position
        return InPlane((x, z), None)
    x, y, z = position
    distance = math.hypot(x, y)
    tip = (distance - m.slew_offset, z)
    if distance < ROUNDING:
        return InPlane(tip, near)
    low, high, angle = float(m.joint_min[0]), float(m.joint_max[0]), math.atan2(y, x)
    turns = math.ceil((low - ROUNDING - angle) / WHOLE_TURN)
    angles = np.arange(angle + turns * WHOLE_TURN, high + ROUNDING, WHOLE_TURN)
    if len(angles) == 0:
        raise OutOfWorkspaceError(
            position,
            f"joint 1 would have to slew to {angle:.4g} rad, within {low:.4g} … {high:.4g} rad it "
            "can",
        )
    nearest = float(angles[np.argmin(np.abs(angles - near))])
    return InPlane(tip, min(high, max(low, nearest)))


def from_the_side(m: MachineArrays, place: FloatArray) -> FloatArray:
    """Positions in the plane, float64[…, 2], that those in `base_link` have when it is there,
    float64[…, 2 or 3] m."""
    if not m.slews:
        return place
    distance = np.hypot(place[..., 0], place[..., 1])
    return np.stack([distance - m.slew_offset, place[..., 2]], axis=-1)


def in_base(m: MachineArrays, tip: FloatArray, slew: FloatArray) -> FloatArray:
    """Positions in `base_link`, float64[…, 2 or 3], of those in the plane, float64[…, 2] m.

    slew  float64[…] rad
    """
    if not m.slews:
        return tip
    distance = m.slew_offset + tip[..., 0]
    return np.stack([distance * np.cos(slew), distance * np.sin(slew), tip[..., 1]], axis=-1)
