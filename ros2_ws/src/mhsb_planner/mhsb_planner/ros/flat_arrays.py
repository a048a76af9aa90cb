"""Parameters that are rows of numbers, one after the other, as ROS knows no nested arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from mhsb_planner.errors import RequestError

FARTHEST_POINT = 1e4
"""Largest coordinate or radius of points and zones [m]."""


def declare_array(node: Node, name: str, values: Sequence[float], text: str) -> None:
    """Declare an array that may be empty: an empty one says nothing of its type on the wire.

    Its numbers are lengths up to FARTHEST_POINT. The descriptor says so, but rclpy looks at the
    ranges of single numbers alone.

    Args:
        node: Gets the parameter.
        name: Of the parameter.
        values: At first.
        text: What it is, for whoever describes the parameter.
    """
    limits = FloatingPointRange(from_value=-FARTHEST_POINT, to_value=FARTHEST_POINT, step=0.0)
    descriptor = ParameterDescriptor(
        description=text, dynamic_typing=True, floating_point_range=[limits]
    )
    node.declare_parameter(name, list(values), descriptor)
    if not node.get_parameter(name).value:
        node.set_parameters([Parameter(name, Parameter.Type.DOUBLE_ARRAY, [])])


def rows_of(name: str, value: Any, size: int, numbers: str) -> tuple[tuple[float, ...], ...]:
    """A flat array in rows of so many numbers; raises RequestError where it is not one.

    numbers  what they are, for the sentence
    """
    given = [] if value is None else value
    if isinstance(given, str) or not isinstance(given, Sequence):
        raise RequestError(name, repr(given), f"must be an array of numbers, {numbers}")
    flat = list(given)
    if not all(isinstance(number, (int, float)) for number in flat):
        raise RequestError(name, flat, f"must hold nothing but numbers, {numbers}")
    if len(flat) % size:
        raise RequestError(name, f"{len(flat)} numbers", f"takes {size} for each, {numbers}")
    return tuple(tuple(map(float, flat[i : i + size])) for i in range(0, len(flat), size))
