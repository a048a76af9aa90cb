"""Options of one goal: parameters of the planner node for it alone, as NAME:=VALUE."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rcl_interfaces.msg import Parameter as ParameterMessage
from rclpy.node import Node
from rclpy.parameter import Parameter, get_parameter_value

from mhsb_model.machine import Machine
from mhsb_planner.errors import RequestError
from mhsb_planner.ros import planner_parameters
from mhsb_planner.ros.zone_parameters import ZONES

WHOLE_NUMBERS = Parameter.Type.DOUBLE_ARRAY, Parameter.Type.INTEGER_ARRAY
OF_ALL_GOALS = {
    "payload_from",
    "lead_min",
    "lead_max",
    "planning_budget",
    *ZONES,
}
OPTIONS = tuple(name for name in planner_parameters.CHANGEABLE if name not in OF_ALL_GOALS)
"""Parameters that a goal may have its own of."""


def decode(node: Node, machine: Machine, texts: Sequence[str]) -> list[Parameter]:
    """The parameters that a goal has its own of.

    texts  each NAME:=VALUE, the value in YAML, as on a command line after `-p`

    Raises RequestError for what is no option, or that the node would refuse as a parameter.
    """
    changes = [_decode(node, text) for text in texts]
    if reason := planner_parameters.refusal(node, machine, changes):
        raise RequestError("options", list(texts), f"cannot be taken: {reason}")
    return changes


def _decode(node: Node, text: str) -> Parameter:
    name, assigned, value = text.partition(":=")
    name = name.strip()
    if not assigned or not value.strip():
        raise RequestError("options", f"'{text}'", "must be NAME:=VALUE, as in planner:=table")
    if name not in OPTIONS:
        raise RequestError("options", f"'{name}'", f"is not one of: {', '.join(OPTIONS)}")
    given = get_parameter_value(value.strip())
    parameter = Parameter.from_parameter_msg(ParameterMessage(name=name, value=given))
    return _as_declared(node, parameter)


def _as_declared(node: Node, given: Parameter) -> Parameter:
    """With whole numbers as numbers; raises RequestError where type or range are wrong."""
    declared = node.get_parameter(given.name)
    value: Any = given.value
    if declared.type_ is Parameter.Type.DOUBLE and given.type_ is Parameter.Type.INTEGER:
        value = float(value)
    elif (declared.type_, given.type_) == WHOLE_NUMBERS:
        value = [float(each) for each in value]
    parameter = Parameter(given.name, value=value)
    if parameter.type_ is not declared.type_:
        kind = declared.type_.name.lower().replace("_", " ")
        raise RequestError(f"options: {given.name}", repr(given.value), f"must be a {kind}")
    for limits in node.describe_parameter(given.name).floating_point_range:
        if not isinstance(value, float):  # the numbers of arrays are looked at with all others
            continue
        if not limits.from_value <= value <= limits.to_value and value == value:
            rule = f"must be from {limits.from_value:g} to {limits.to_value:g}"
            raise RequestError(f"options: {given.name}", value, rule)
    return parameter
