"""The planner node's parameters: what they ask for, and what is refused."""

from collections.abc import Iterator

import pytest
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

from mhsb_model.command_line import UsageError
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
    assert (found.planner, found.options.planner) == ("integrated", "integrated")
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


def test_the_area_is_weighed_by_the_integrated_planner_alone(node, machine):
    node.set_parameters([Parameter("planner", value="table")])
    weight = Parameter("area_weight", value=300.0)
    reason = planner_parameters.refusal(node, machine, [weight])
    assert reason == (
        "area_weight 300 needs planner 'integrated' (is 'table'); "
        "set it to 0 or choose that planner"
    )
    together = [weight, Parameter("planner", value="integrated")]
    assert planner_parameters.refusal(node, machine, together) is None
    node.set_parameters(together)
    assert planner_parameters.read(node).options.area_weight == 300.0


def test_parameters_that_clash_from_the_start_are_refused(ros_context, machine):
    overrides = [Parameter("area_weight", value=300.0), Parameter("planner", value="fixed")]
    node = Node("clashing", context=ros_context, parameter_overrides=overrides)
    with pytest.raises(UsageError, match="area_weight 300 needs planner 'integrated'"):
        planner_parameters.declare(node, machine)
    node.destroy_node()
