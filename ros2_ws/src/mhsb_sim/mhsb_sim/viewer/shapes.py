"""Directions and colours as the browser's scene takes them."""

from __future__ import annotations

import math
from collections.abc import Sequence

from mhsb_model.types import FloatArray

Quaternion = tuple[float, float, float, float]
Color = tuple[int, int, int]


def along(direction: FloatArray) -> Quaternion:
    """w, x, y, z of the shortest turn of z into a unit vector float64[3]."""
    x, y, z = direction.tolist()
    if z < -1.0 + 1e-9:
        return (0.0, 1.0, 0.0, 0.0)
    w = math.sqrt((1.0 + z) / 2.0)
    return (w, -y / (2.0 * w), x / (2.0 * w), 0.0)


def turned_up(angle: float) -> Quaternion:
    """w, x, y, z of a turn of x towards z by an angle [rad]: about −y."""
    return (math.cos(angle / 2), 0.0, -math.sin(angle / 2), 0.0)


def turned_left(angle: float) -> Quaternion:
    """w, x, y, z of a turn of x towards y by an angle [rad]: about z."""
    return (math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2))


def bytes_of(color: Sequence[float]) -> Color:
    """Red, green, blue, from shares of 1."""
    red, green, blue = (round(255 * part) for part in color)
    return (red, green, blue)
