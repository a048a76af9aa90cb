"""Options of one goal: values of the planner node's parameters for this goal alone.

An option has the form NAME:=VALUE. Options come from anyone who may send goals. So their number and
length are checked before they are parsed, and each value is checked before ROS converts it to a
parameter.
"""

from collections.abc import Sequence
from typing import Any

from rclpy.node import Node
from rclpy.parameter import Parameter

from mhsb_model.files.yaml_files import YamlTextError, read_value
from mhsb_model.machine import Machine
from mhsb_planner.errors import RequestError
from mhsb_planner.ros import planner_parameters
from mhsb_planner.ros.zone_parameters import ZONE_PARAMETERS

MOST_OPTIONS = 100
"""Largest number of options of a goal."""

LONGEST_OPTION = 4096
"""Largest length of an option in characters.

An option `goal_via` with a hundred points in full precision is shorter."""

LONGEST_SHOWN = 80
"""Largest number of characters of an option that are shown in the sentence of a refusal."""

NUMBER_ARRAY_TYPES = Parameter.Type.DOUBLE_ARRAY, Parameter.Type.INTEGER_ARRAY
"""Types of parameters whose value is a list of numbers."""

OF_ALL_GOALS = {
    "payload_from",
    "lead_min",
    "lead_max",
    "planning_budget",
    *ZONE_PARAMETERS,
}
"""Parameters that apply to all goals and cannot be options of a single goal."""

GOAL_OPTION_NAMES = tuple(
    name for name in planner_parameters.CHANGEABLE_PARAMETERS if name not in OF_ALL_GOALS
)
"""Parameters that can be options of a single goal."""


def decode(node: Node, machine: Machine, texts: Sequence[str]) -> list[Parameter]:
    """Decode the options of a goal into parameters, and check that they can be used together.

    The checks are the same as for a change of the node's parameters. The node's own parameters are
    not changed.

    Args:
        node: Planner node, which has declared its parameters.
        machine: Machine of the node.
        texts: Options as NAME:=VALUE with the value in YAML, as on a command line after `-p`.

    Returns:
        One parameter for each option, in the same order.

    Raises:
        RequestError: There are more than `MOST_OPTIONS`, a text is not an option, or the node would
            refuse the values as parameters.
    """
    if len(texts) > MOST_OPTIONS:
        raise RequestError("options", len(texts), f"must be at most {MOST_OPTIONS}")
    changes = [_decode(node, text) for text in texts]
    if reason := planner_parameters.find_refusal(node, machine, changes):
        raise RequestError("options", _shorten(", ".join(texts)), f"cannot be taken: {reason}")
    return changes


def _decode(node: Node, text: str) -> Parameter:
    """Decode one option of a goal.

    Args:
        node: Planner node, which has declared its parameters.
        text: NAME:=VALUE.

    Returns:
        The parameter, with its value converted to the type that the node has declared.

    Raises:
        RequestError: The text is too long or has another form, its name is not an option of goals,
            or its value cannot be used.
    """
    if len(text) > LONGEST_OPTION:
        rule = f"must each have at most {LONGEST_OPTION} characters"
        raise RequestError("options", f"{len(text)} in '{_shorten(text)}'", rule)
    name, assigned, value = text.partition(":=")
    name = name.strip()
    if not assigned or not value.strip():
        rule = "must be NAME:=VALUE, as in planner:=table"
        raise RequestError("options", f"'{_shorten(text)}'", rule)
    if name not in GOAL_OPTION_NAMES:
        rule = f"is not one of: {', '.join(GOAL_OPTION_NAMES)}"
        raise RequestError("options", f"'{_shorten(name)}'", rule)
    try:
        given = read_value(value.strip())
    except YamlTextError as error:
        rule = f"cannot be read: its value {error.reason}"
        raise RequestError(f"options: {name}", _shorten(value), rule) from None
    return Parameter(name, value=_convert_to_declared_type(node, name, given, value))


def _convert_to_declared_type(node: Node, name: str, given: Any, text: str) -> Any:
    """Convert a value to the declared type of its parameter. Integers become floats.

    Args:
        node: Node that has declared the parameter.
        name: Name of the parameter.
        given: Value as read from YAML.
        text: Value as it was sent, for the error.

    Returns:
        A float, a list of floats or a text. The range of a single float has been checked, the range
        of a list has not.

    Raises:
        RequestError: The value has another type, or a single number is out of the declared range.
    """
    declared = node.get_parameter(name).type_
    if declared is Parameter.Type.DOUBLE and _is_number(given):
        return _check_range(node, name, float(given))
    if declared in NUMBER_ARRAY_TYPES and isinstance(given, list) and all(map(_is_number, given)):
        return [float(each) for each in given]
    if declared is Parameter.Type.STRING and isinstance(given, str):
        return given
    kind = (
        "double array"
        if declared in NUMBER_ARRAY_TYPES
        else declared.name.lower().replace("_", " ")
    )
    raise RequestError(f"options: {name}", f"'{_shorten(text)}'", f"must be a {kind}")


def _is_number(value: Any) -> bool:
    """Return whether a value is an int or a float, but not a bool."""
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _check_range(node: Node, name: str, value: float) -> float:
    """Check that a number is within the declared range of its parameter, and return it.

    NaN is accepted. A parameter without a declared range accepts every number.

    Args:
        node: Node that has declared the parameter.
        name: Name of the parameter.
        value: The number.

    Returns:
        The same number.

    Raises:
        RequestError: The number is out of the range.
    """
    for limits in node.describe_parameter(name).floating_point_range:
        if not limits.from_value <= value <= limits.to_value and value == value:
            rule = f"must be from {limits.from_value:g} to {limits.to_value:g}"
            raise RequestError(f"options: {name}", value, rule)
    return value


def _shorten(text: str) -> str:
    """Strip a text, and replace all after `LONGEST_SHOWN` characters by ` …`."""
    text = text.strip()
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]} …"
