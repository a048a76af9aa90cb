"""The simulator node's parameters: every number has a range, and is refused beyond it."""

import math

import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter

from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import load_machine
from mhsb_sim.ros import sim_parameters


@pytest.fixture
def node(ros_context):
    node = Node("parameters", context=ros_context)
    machine = load_machine()
    sim_parameters.declare_parameters(node, machine, machine)
    yield node
    node.destroy_node()


def test_every_number_has_a_range_and_is_refused_beyond_it(node):
    tried = 0
    for name in node.get_parameters_by_prefix("").keys() - {"use_sim_time"}:
        descriptor, value = node.describe_parameter(name), node.get_parameter(name).value
        if isinstance(value, bool | str) or not isinstance(value, int | float):
            continue
        (limits,) = [*descriptor.floating_point_range, *descriptor.integer_range]
        assert math.isfinite(limits.from_value)
        assert math.isfinite(limits.to_value)
        for beyond in (1e308, -1e308) if isinstance(value, float) else (2**62, -(2**62)):
            result = node.set_parameters([Parameter(name, value=beyond)])[0]
            assert not result.successful
            assert name in result.reason
            assert "\n" not in result.reason
            tried += 1
    assert tried > 40


def test_controller_and_limits_follow_from_the_sensors_and_can_be_overridden(ros_context):
    machine = load_machine(find_config_file("excavator_1to14.yaml"))
    given = [Parameter("held_limit", value=20.0), Parameter("controller", value="")]
    node = Node("parameters", context=ros_context, parameter_overrides=given[:1])
    settings = sim_parameters.declare_parameters(node, machine, machine)
    node.destroy_node()
    assert settings.controller == "lag_compensated"
    assert settings.limits.following_error == (0.15, 0.5)
    assert settings.limits.held == (5.0, 20.0)
    node = Node("parameters", context=ros_context, parameter_overrides=given[1:])
    settings = sim_parameters.declare_parameters(node, machine, machine)
    node.destroy_node()
    assert settings.controller == ""  # which the simulator takes as None
    assert settings.limits.held == (5.0, 15.0)
