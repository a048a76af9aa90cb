"""Values of parameters at the start of a node."""

import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter

from mhsb_msgs_py.parameters import NodeParameter, ParameterValueError

MASS = NodeParameter("payload", 2.0, "mass at the tip [kg]", (0.0, 100.0))


@pytest.mark.parametrize(
    ("parameter", "given", "sentence"),
    [
        (MASS, "abc", "payload takes a number with a decimal point (is 'abc')"),
        (MASS, 5, "payload takes a number with a decimal point (is 5); give 5.0"),
        (MASS, -5.0, "payload must be from 0 to 100 kg (is -5)"),
        (MASS, float("nan"), "payload must be from 0 to 100 kg (is nan)"),
        (NodeParameter("seed", 0, "of noise", (0, 9)), "a", "seed takes a whole number (is 'a')"),
        (NodeParameter("seed", 0, "of noise", (0, 9)), 10, "seed must be from 0 to 9 (is 10)"),
        (NodeParameter("fault", "", "a fault"), 3, "fault takes text (is 3)"),
        (NodeParameter("held", False, "stays"), "maybe", "held takes true or false (is 'maybe')"),
        (
            NodeParameter("weights", [1.0, 2.0], "weights"),
            3.0,
            "weights takes an array of numbers with decimal points (is 3.0)",
        ),
    ],
)
def test_a_value_that_a_parameter_does_not_take_is_refused_in_one_sentence(
    ros_context, parameter, given, sentence
):
    overrides = [Parameter(parameter.name, value=given)]
    node = Node("starting", context=ros_context, parameter_overrides=overrides)
    with pytest.raises(ParameterValueError) as refused:
        parameter.declare(node)
    assert str(refused.value) == f"after --ros-args: {sentence}"
    node.destroy_node()
