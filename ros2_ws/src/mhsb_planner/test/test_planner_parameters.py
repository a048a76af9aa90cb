"""The planner node's parameters: what they ask for, and what is refused."""

from collections.abc import Iterator

import pytest
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

from mhsb_planner import planner_parameters
from mhsb_planner.planner import PLANNER_KINDS


@pytest.fixture
def node(ros_context: Context, machine) -> Iterator[Node]:
    node = Node("parameters", context=ros_context)
    planner_parameters.declare(node, machine)
    yield node
    node.destroy_node()


def test_left_alone_they_ask_for_the_machine_s_own_values(node, machine):
    found = planner_parameters.read(node)
    assert (found.planner, found.options.planner) == ("table", "table")
    assert found.machine(machine).hash == machine.hash


@pytest.mark.parametrize("kind", PLANNER_KINDS)
def test_the_planner_can_be_chosen(node, machine, kind):
    change = Parameter("planner", value=kind)
    assert planner_parameters.refusal(node, machine, [change]) is None
    node.set_parameters([change])
    assert planner_parameters.read(node).options.planner == kind


def test_a_planner_that_is_not_there_is_refused_with_those_that_are(node, machine):
    reason = planner_parameters.refusal(node, machine, [Parameter("planner", value="guess")])
    assert reason == "planner 'guess' is not there; give one of: table, fixed, integrated"
