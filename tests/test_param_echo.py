"""`mhsb param`, `call` and `echo`, which stand in for `ros2 param`, `service` and `topic`."""

from __future__ import annotations

import contextlib
import json
import math
import threading

import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from mhsb_msgs_py import qos

MEANING = "mass at the tip [kg]"


@pytest.fixture
def node(ros_context):
    """A node with parameters, a latched topic and one that streams, served by a thread."""
    node = Node("some_node", context=ros_context)
    bounds = [FloatingPointRange(from_value=0.0, to_value=10.0)]
    node.declare_parameter(
        "payload", 1.5, ParameterDescriptor(description=MEANING, floating_point_range=bounds)
    )
    node.declare_parameter("planner", "table")
    node.declare_parameter("boxes", [0.1, 0.2])
    status = DiagnosticStatus(level=b"\x01", name="x", values=[KeyValue(key="a", value="b")])
    latched = node.create_publisher(DiagnosticArray, "latched", qos.LATCHED)
    latched.publish(DiagnosticArray(status=[status]))
    states = node.create_publisher(JointState, "states", qos.DEFAULT)
    node.create_timer(0.1, lambda: states.publish(JointState(name=["j"], position=[0.25])))
    for name, success in (("start", True), ("stop", False)):
        answer = Trigger.Response(success=success, message=f"{name} asked")
        node.create_service(Trigger, f"~/{name}", lambda _, __, answer=answer: answer)
    executor = SingleThreadedExecutor(context=ros_context)
    executor.add_node(node)

    def serve() -> None:
        with contextlib.suppress(ExternalShutdownException):
            executor.spin()

    thread = threading.Thread(target=serve)
    thread.start()
    yield node
    executor.shutdown()
    thread.join()
    node.destroy_node()


@pytest.fixture
def mhsb(start_fork):
    """Function (words...) to exit code and output of a subcommand."""

    def run(*words: str) -> tuple[int, str]:
        child = start_fork("mhsb_tools", "mhsb", *words)
        return child.wait(60), child.output

    return run


def test_parameters_are_listed_with_their_meaning(mhsb, node):
    code, output = mhsb("param", "list", "some_node")
    assert code == 0
    assert {f"payload: 1.5  # {MEANING}", "planner: table", "boxes: [0.1, 0.2]"} <= {
        *output.splitlines()
    }


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [
        ("payload", "3", 3.0),
        ("planner", "integrated", "integrated"),
        ("boxes", "[]", []),
        ("boxes", "[1, -2.5]", [1.0, -2.5]),
    ],
)
def test_a_parameter_is_set_and_read(mhsb, node, name, text, value):
    assert mhsb("param", "set", "some_node", name, text)[0] == 0
    code, output = mhsb("param", "get", "some_node", name, "--json")
    assert (code, json.loads(output)) == (0, {name: value})


@pytest.mark.parametrize("text", [".nan", "nan", ".NaN", "NaN"])
def test_a_number_can_be_set_to_nan_in_any_usual_spelling(mhsb, node, text):
    node.declare_parameter("angle", 0.5)
    code, output = mhsb("param", "set", "some_node", "angle", text)
    assert (code, output) == (0, "NaN\n")
    assert math.isnan(node.get_parameter("angle").value)


@pytest.mark.parametrize("command", ["call", "echo"])
@pytest.mark.parametrize("name", ["", "a b", "9a"])
def test_a_name_that_ros_does_not_take_is_refused_in_one_sentence(mhsb, ros_domain, command, name):
    code, output = mhsb(command, name)
    assert code == 2
    assert "name must not" in output or "name token must not" in output
    assert output.endswith(f"'{name}'\n")
    assert len(output.splitlines()) == 1


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("set", "some_node", "payload", "heavy"), "payload takes a value of type double, not"),
        (("set", "some_node", "payload", "-1"), "some_node refused payload: "),
        (("get", "some_node", "paylod"), "no parameter paylod; did you mean payload?"),
        (("list", "nobody", "--timeout", "4"), "no node nobody answers within 4 s; there are "),
    ],
)
def test_a_refusal_is_one_sentence(mhsb, node, words, sentence):
    code, output = mhsb("param", *words)
    assert code == 1
    assert sentence in output
    assert len(output.splitlines()) == 1


def test_a_service_is_called_and_its_answer_printed(mhsb, node):
    assert mhsb("call", "some_node/start") == (0, "start asked\n")
    code, output = mhsb("call", "some_node/stop", "--json")
    assert code == 1
    assert json.loads(output.splitlines()[0]) == {"success": False, "message": "stop asked"}
    assert "some_node/stop has refused: stop asked" in output


def test_a_service_that_nobody_offers_is_named_with_those_there_are(mhsb, node):
    code, output = mhsb("call", "some_node/sing", "--timeout", "4")
    assert code == 1
    assert "no service some_node/sing within 4 s; there are /some_node/start" in output


def test_a_latched_message_is_printed_as_yaml(mhsb, node):
    code, output = mhsb("echo", "latched", "--once")
    assert code == 0
    text, end = output.split("---")
    [status] = yaml.safe_load(text)["status"]
    assert status["level"] == 1
    assert status["values"] == [{"key": "a", "value": "b"}]
    assert end == "\n"


def test_a_stream_is_printed_as_json_lines_until_a_signal(start, node):
    child = start("mhsb_tools", "mhsb", "echo", "/states", "--json")
    child.wait_for(r'"position": \[0\.25\]', 30)
    assert child.stop() == 0
    assert "Traceback" not in child.output


def test_a_topic_that_nobody_publishes_is_answered_with_those_there_are(mhsb, node):
    code, output = mhsb("echo", "nowhere", "--timeout", "4")
    assert code == 1
    assert "nobody publishes /nowhere within 4 s; there are /" in output
    assert "/states" in output
