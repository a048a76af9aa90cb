"""Orientations and colours in the form that the browser's scene uses."""

import math
from collections.abc import Sequence

from mhsb_model.types import FloatArray

Quaternion = tuple[float, float, float, float]
"""Unit quaternion (w, x, y, z)."""

Color = tuple[int, int, int]
"""Red, green and blue, each from 0 to 255."""


def get_rotation_to(direction: FloatArray) -> Quaternion:
    """Return the shortest rotation that turns the z axis into a direction.

    Args:
        direction: Unit vector, shape (3,).

    Returns:
        Unit quaternion (w, x, y, z). For the direction −z it is a half turn about x.
    """
    x, y, z = direction.tolist()
    if z < -1.0 + 1e-9:
        return (0.0, 1.0, 0.0, 0.0)
    w = math.sqrt((1.0 + z) / 2.0)
    return (w, -y / (2.0 * w), x / (2.0 * w), 0.0)


def get_rotation_up(angle: float) -> Quaternion:
    """Return the rotation from x towards z by an angle [rad], which is about -y."""
    return (math.cos(angle / 2), 0.0, -math.sin(angle / 2), 0.0)


def get_rotation_left(angle: float) -> Quaternion:
    """Return the rotation from x towards y by an angle [rad], which is about z."""
    return (math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2))


def bytes_of(color: Sequence[float]) -> Color:
    """Convert red, green and blue from the range 0 to 1 to the range 0 to 255."""
    red, green, blue = (round(255 * part) for part in color)
    return (red, green, blue)
