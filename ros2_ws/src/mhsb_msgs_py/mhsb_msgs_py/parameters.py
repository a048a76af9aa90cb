"""Declaration of the nodes' parameters, with description and range."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from mhsb_model.machine import Machine, load_machine


@dataclass(frozen=True)
class NodeParameter:
    """Parameter that a node declares.

    Attributes:
        name: Name of the parameter.
        default: Initial value, which also determines the type.
        text: Description.
        limits: Least and greatest number; None for no range. rclpy enforces the range for single
            numbers, but not for arrays.
        read_only: Whether the parameter cannot be changed after the start.
        may_be_empty: Whether it is an array of numbers that may be empty.
    """

    name: str
    default: bool | float | str | Sequence[float]
    text: str
    limits: tuple[float, float] | None = None
    read_only: bool = False
    may_be_empty: bool = False

    def declare(self, node: Node) -> Any:
        """Declare the parameter on a node, and return its value.

        ROS cannot tell the type of an empty array. If the value is empty and may be
        (`may_be_empty`), its type is set to double array.

        Args:
            node: Node that gets the parameter.

        Returns:
            The value that was given at the start of the node, else `default`.

        Raises:
            ParameterException: The value that was given has another type than `default`, or is
                outside `limits`.
        """
        descriptor = ParameterDescriptor(
            description=self.text, read_only=self.read_only, dynamic_typing=self.may_be_empty
        )
        if self.limits is not None and type(self.default) is int:
            least, greatest = map(int, self.limits)
            limits = IntegerRange(from_value=least, to_value=greatest, step=1)
            descriptor.integer_range = [limits]
        elif self.limits is not None:
            least, greatest = self.limits
            limits = FloatingPointRange(from_value=least, to_value=greatest, step=0.0)
            descriptor.floating_point_range = [limits]
        value = node.declare_parameter(self.name, self.default, descriptor).value
        if self.may_be_empty and not value:
            node.set_parameters([Parameter(self.name, Parameter.Type.DOUBLE_ARRAY, [])])
        return value


def declare_machine(node: Node) -> Machine:
    """Declare the parameter `machine`, and load the machine file that it names.

    Args:
        node: The node.

    Returns:
        The machine; the suite's own arm if the parameter is empty.

    Raises:
        MachineFileError: The file is missing or not valid.
    """
    text = "machine file (YAML); empty for the suite's own arm"
    return load_machine(NodeParameter("machine", "", text, read_only=True).declare(node) or None)
