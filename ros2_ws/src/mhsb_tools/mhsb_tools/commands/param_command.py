"""`param`: list, read and set the parameters of a running node, as `ros2 param` does."""

import json as json_format
import re
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import tyro
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.task import Future

from mhsb_model import command_line
from mhsb_model.command_line import NumberRange
from mhsb_model.errors import MhsbError, suggest_name
from mhsb_msgs_py.node_process import run_command_node, spin_until
from mhsb_tools.commands.echo_command import format_json, to_plain

NAN_SPELLING = re.compile(r"(?<![\w.])\.?nan\b", re.IGNORECASE)
"""Spellings of NaN in Python and YAML, such as `nan` and `.NaN`; JSON in Python has only `NaN`."""


class ParameterError(MhsbError):
    """A parameter cannot be read or set."""


def param(
    action: Annotated[Literal["list", "get", "set"], tyro.conf.Positional],
    node: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="NODE")],
    name: Annotated[str | None, tyro.conf.Positional, tyro.conf.arg(metavar="[NAME]")] = None,
    value: Annotated[str | None, tyro.conf.Positional, tyro.conf.arg(metavar="[VALUE]")] = None,
    timeout: Annotated[float, tyro.conf.arg(metavar="S"), NumberRange(0.0, 1e6)] = 10.0,
    json: bool = False,
) -> None:
    """List, read and set the parameters of a running node.

    `param list NODE` prints all parameters with value and meaning, `param get NODE NAME` one value,
    and `param set NODE NAME VALUE` sets one. The planner plans with it from the next plan on. Units
    are SI and stand in the meaning: m, rad, s, kg, Pa.

    Args:
        action: What to do.
        node: Name of the node, such as mhsb_planner or mhsb_sim.
        name: Name of the parameter.
        value: New value; an array is [0.65, 0.1, 0.9, 0.3].
        timeout: How long to wait for the node, and for each answer [s].
        json: Print values, by name, as one JSON object; NaN and infinite numbers are null.

    Raises:
        UsageError: The action takes fewer or more words.
        ParameterError: There is no such node or parameter, the value has a wrong type, or the node
            refuses it or does not answer in time.
        RosNameError: ROS does not take the name of the node.
        RosError: ROS cannot make a node in this environment.
    """
    given = [each for each in (name, value) if each is not None]
    words = {"list": "NODE", "get": "NODE NAME", "set": "NODE NAME VALUE"}[action]
    if len(given) != len(words.split()) - 1:
        raise command_line.UsageError(f"{action} takes {words}")
    with run_command_node(lambda: Node("mhsb_param")) as (executor, own):
        parameters = _RemoteParameters(own, executor, node, timeout)
        if action == "set":
            parameters.change(given[0], given[1])
        values = parameters.read(given[:1] or parameters.list_names())
        meanings = parameters.describe(list(values)) if action == "list" else {}
    if json:
        print(format_json(values))
    elif action == "list":
        for key, each in values.items():
            print(f"{key}: {_format(each)}" + (f"  # {meanings[key]}" if meanings[key] else ""))
    else:
        print(_format(values[given[0]]))


class _RemoteParameters:
    """Parameters of another node, read and set over its services."""

    def __init__(
        self, own: Node, executor: SingleThreadedExecutor, name: str, timeout: float
    ) -> None:
        """Wait until the parameter services of the other node are available.

        Args:
            own: Node of this process.
            executor: Executor that serves `own`.
            name: Name of the node whose parameters are read and set.
            timeout: Longest wait for the services now, and for each answer later, each [s].

        Raises:
            ParameterError: The services are not available in time.
        """
        self._name, self._executor, self._timeout = name, executor, timeout
        self._client = AsyncParameterClient(own, name)
        if not spin_until(executor, self._client.services_are_ready, timeout):
            others = sorted({*own.get_node_names()} - {own.get_name()})
            there = f"there are {', '.join(others)}" if others else "no node runs"
            raise ParameterError(
                f"no node {name} answers within {timeout:g} s; {there} in this ROS domain"
            )

    def _wait(self, answer: Future) -> Any:
        """Return the result of a request; the node of this command is served meanwhile.

        Raises:
            ParameterError: No result came within the command's timeout.
        """
        if not spin_until(self._executor, answer.done, self._timeout):
            raise ParameterError(f"{self._name} gave no answer within {self._timeout:g} s")
        return answer.result()

    def list_names(self) -> list[str]:
        """Return the names of all parameters in alphabetical order.

        Raises:
            ParameterError: The node gave no answer in time.
        """
        return sorted(self._wait(self._client.list_parameters()).result.names)

    def read(self, names: list[str]) -> dict[str, Any]:
        """Read parameters of the node.

        Args:
            names: Names of the parameters.

        Returns:
            Value by name, in the order of `names`; arrays are lists.

        Raises:
            ParameterError: The node has no parameter of one of the names, or gives no answer in
                time. The message suggests the most similar name.
        """
        answer = self._wait(self._client.get_parameters(names))
        values = {
            name: to_plain(parameter_value_to_python(each))
            for name, each in zip(names, answer.values, strict=False)
        }
        for name in names:
            if values.get(name) is None:
                near = suggest_name(name, self.list_names())
                raise ParameterError(f"{self._name} has no parameter {name}{near}")
        return values

    def describe(self, names: list[str]) -> Mapping[str, str]:
        """Return the description of each parameter, by name.

        Raises:
            ParameterError: The node gave no answer in time.
        """
        answer = self._wait(self._client.describe_parameters(names))
        return {each.name: each.description for each in answer.descriptors}

    def change(self, name: str, text: str) -> None:
        """Set a parameter of the node to the value that a text stands for.

        Args:
            name: Name of the parameter.
            text: The value. It is parsed as JSON, such as `[0.65, 0.1]`; for a parameter of type
                string it is taken as it is.

        Raises:
            ParameterError: There is no such parameter, the text has the wrong type, or the node
                refuses the value or does not answer in time.
        """
        self.read([name])
        [descriptor] = self._wait(self._client.describe_parameters([name])).descriptors
        kind = Parameter.Type(descriptor.type)
        try:
            parameter = Parameter(name, kind, _parse(text, kind))
        except (ValueError, AssertionError, TypeError):
            raise ParameterError(
                f"{name} takes a value of type {kind.name.lower()}, not '{text}'"
            ) from None
        [result] = self._wait(self._client.set_parameters([parameter])).results
        if not result.successful:
            raise ParameterError(f"{self._name} refused {name}: {result.reason}")


def _parse(text: str, kind: Parameter.Type) -> Any:
    """Convert a text to a value of a parameter's type.

    Args:
        text: The text. It is parsed as JSON; for type STRING it is returned as it is. For type
            BOOL, capital letters are accepted, as in `True`. NaN may be spelled as in YAML.
        kind: Type of the ROS parameter.

    Returns:
        The value. For DOUBLE and DOUBLE_ARRAY, integers are converted to float. Whether the value
        has the right type is not checked otherwise.

    Raises:
        ValueError: The text is not JSON, or a text in an array is not a number.
        TypeError: `kind` is DOUBLE_ARRAY and the text is not an array of numbers.
    """
    if kind is Parameter.Type.STRING:
        return text
    text = text.lower() if kind is Parameter.Type.BOOL else NAN_SPELLING.sub("NaN", text)
    value = json_format.loads(text)
    if kind is Parameter.Type.DOUBLE and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if kind is Parameter.Type.DOUBLE_ARRAY:
        return [float(each) for each in value]
    return value


def _format(value: Any) -> str:
    """Return a value as a text that `param set` takes."""
    return value if isinstance(value, str) else json_format.dumps(value)


main = command_line.make_main(param, node=True)
