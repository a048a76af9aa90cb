"""Declaration of the nodes' parameters, with description and range."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter

from mhsb_model.errors import ArgumentError, suggest_unit_of_number
from mhsb_model.machine import Machine, load_machine

UNIT_IN_DESCRIPTION = re.compile(r"\[([^]]+)\]")
"""Unit in the description of a parameter, such as `[Pa]`."""

VALUE_KINDS = {
    bool: "true or false",
    int: "a whole number",
    float: "a number with a decimal point",
    str: "text",
}
"""Values that a parameter takes, by the type of its default; all others are arrays of numbers."""


class ParameterValueError(ArgumentError):
    """Error: a parameter cannot have the value that was given at the start of its node."""


def describe_passed_range(name: str, value: float, text: str, least: float, greatest: float) -> str:
    """Describe a number that is out of its parameter's range.

    Args:
        name: Name of the parameter.
        value: The number.
        text: Description of the parameter, which has the unit in brackets if there is one.
        least: Smallest allowed number.
        greatest: Largest allowed number.

    Returns:
        One sentence with range and unit. If the number would be in range in another unit, the
        sentence suggests that unit.
    """
    units = UNIT_IN_DESCRIPTION.findall(text)
    unit = units[-1] if units else ""
    hint = suggest_unit_of_number(value, unit, least, greatest)
    words = f"{least:g} to {greatest:g} {unit}".rstrip()
    return f"{name} must be from {words} (is {value:g}){hint}"


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

        ROS cannot tell the type of an empty array. So an empty value of a parameter with
        `may_be_empty` is set once more, as a double array.

        Args:
            node: Node that gets the parameter.

        Returns:
            The value that was given at the start of the node, else `default`.

        Raises:
            ParameterValueError: The value that was given has another type than `default`, or is
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
        try:
            value = node.declare_parameter(self.name, self.default, descriptor).value
        except ParameterException as error:
            reason = self._describe_refusal(node._parameter_overrides[self.name].value)
            raise ParameterValueError(f"after --ros-args: {reason}") from error
        if self.may_be_empty and not value:
            node.set_parameters([Parameter(self.name, Parameter.Type.DOUBLE_ARRAY, [])])
        return value

    def _describe_refusal(self, given: Any) -> str:
        """Return one sentence on why rclpy has refused a value.

        Args:
            given: The value, of a wrong type or outside `limits`.
        """
        has_right_type = type(given) is type(self.default)
        if self.limits is not None and has_right_type:
            return describe_passed_range(self.name, given, self.text, *self.limits)
        kind = VALUE_KINDS.get(type(self.default), "an array of numbers with decimal points")
        is_whole = type(given) is int and type(self.default) is float
        return f"{self.name} takes {kind} (is {given!r}){f'; give {given}.0' if is_whole else ''}"


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
