"""Everything that reaches the nodes from outside, by the tables of docs/security.md.

The page must name all that the running nodes subscribe and serve, and what it says of an input that
cannot be used must happen. Random inputs are given elsewhere.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import ListParameters, SetParameters
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import UInt8MultiArray
from trajectory_msgs.msg import JointTrajectory

from mhsb_model.goal import Goal
from mhsb_model.verdict import Outcome, Verdict
from mhsb_msgs_py import goal_pose, names, qos, topics
from mhsb_msgs_py.guarded_executor import MOST_CHANGES
from mhsb_msgs_py.node_process import serve_node, spin_until
from mhsb_planner.ros.goal_sender import GoalSender

DOCS = Path(__file__).parents[1] / "docs"
PAGE = DOCS / "security.md"
NODES = names.PLANNER_NODE, names.SIM_NODE
OF_ROS = {"use_sim_time", "start_type_description_service"}
"""Parameters of every node."""

TAKEN_AS_NUMBERS = {(ParameterType.PARAMETER_INTEGER_ARRAY, ParameterType.PARAMETER_DOUBLE_ARRAY)}
"""Types that a parameter takes beside its own."""

WRONG_TYPE = "Wrong parameter type|must"
NO_NUMBER = "nan|finite|range|must"
BEYOND_RANGE = "range|must"
"""What reasons of refusals say."""

FREE_ANGLES = {"goal_psi", "goal_psi_min", "goal_psi_max"}
"""Parameters of which NaN is a value."""


def rows(page, heading):
    """Cells of each row of the table below a heading of a page whose first cell is code."""
    section = page.read_text().split(f"\n## {heading}\n")[1].split("\n## ")[0]
    lines = [line for line in section.splitlines() if line.startswith("| `")]
    return [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in lines]


def code(cell):
    """What stands in backticks in a cell."""
    return re.findall(r"`([^`]+)`", cell)


def absolute(name, node=""):
    return name if name.startswith("/") else f"/{node}/{name}" if node else f"/{name}"


@pytest.mark.parametrize("node", NODES)
def test_the_page_names_everything_that_a_node_subscribes(arm, node):
    listed = {absolute(code(row[0])[0]) for row in rows(PAGE, f"Topics of {node}")}
    assert arm.topics_of(node) == listed - {"/clock"}


@pytest.mark.parametrize("node", NODES)
def test_the_page_names_everything_that_a_node_serves(arm, node):
    listed = {name for row in rows(PAGE, f"Services of {node}") for name in code(row[0])}
    assert set(arm.services_of(node)) == {absolute(name, node) for name in listed}


def place_without_x():
    """A goal whose x is no number."""
    return goal_pose.encode(Goal(0, float("nan"), 0.1))


def late_nanoseconds():
    """A time with more than a second of nanoseconds."""
    return Time(sec=1, nanosec=2 * 10**9)


def empty_report():
    """A status of the simulator without its values."""
    status = DiagnosticStatus(name="mhsb_sim: simulator", hardware_id="/mhsb_sim")
    return DiagnosticArray(status=[status])


UNUSABLE = {
    "goal_pose": place_without_x,
    "joint_states": JointState,
    "reference": JointTrajectory,
    "plan_in_force": late_nanoseconds,
    "modes": UInt8MultiArray,
    "/diagnostics": empty_report,
    "estimates": lambda: JointState(name=["payload"]),
    "joint_trajectory": JointTrajectory,
    "mode_commands": JointTrajectory,
}
"""Makes a message of each topic that cannot be used."""

TOPICS = [
    (node, code(row[0])[0], code(row[-1])[-1])
    for node in NODES
    for row in rows(PAGE, f"Topics of {node}")
    if row[0] != "`/clock`"
]


class Stranger(GoalSender):
    """Publishes on one topic what cannot be used, and takes down what the planner says of goals."""

    def __init__(self, topic):
        super().__init__()
        self.strange = self.create_publisher(topic.message, topic.name, topic.qos)


@pytest.mark.parametrize(("node", "name", "sentence"), TOPICS)
def test_a_message_that_cannot_be_used_has_the_consequence_that_the_page_names(
    arm, nodes, node, name, sentence
):
    child = nodes("mhsb_sim", "mhsb_planner")[node]
    topic = next(each for each in topics.SUITE_TOPICS if each.name == name)
    before, tip = len(child.output), arm.machine.tip_position(arm.references[-1].state.position)
    with serve_node(lambda: Stranger(topic)) as (executor, stranger):  # not the observer

        def is_said():
            stranger.strange.publish(UNUSABLE[name]())
            spin_until(executor, lambda: False, 0.2)
            verdicts = [each.sentence for each in stranger.verdicts.values()]
            return any(sentence in text for text in (child.output[before:], *verdicts))

        assert spin_until(executor, lambda: stranger.is_matched, 15.0)
        assert spin_until(executor, is_said, 15.0)
        assert "a fault in" not in child.output[before:]
        asked = stranger.send(0.6, 0.1 if tip[1] > 0.2 else 0.3)
        assert spin_until(executor, lambda: asked in stranger.verdicts, 15.0)
        assert stranger.verdicts[asked].code is Verdict.OK, stranger.verdicts[asked].sentence


PARAMETERS = {
    node: {code(row[0])[0]: row for row in rows(DOCS / "parameters.md", f"`{node} {program}`")}
    for node, program in zip(NODES, ("planner_node", "sim_node"), strict=True)
}


def number_like(value, number):
    """A value of a parameter's own type, with a number in it."""
    other = ParameterValue(type=value.type)
    if value.type == ParameterType.PARAMETER_DOUBLE:
        other.double_value = number
    elif value.type == ParameterType.PARAMETER_DOUBLE_ARRAY:
        other.double_array_value = [number] * (len(value.double_array_value) or 12)
    elif value.type == ParameterType.PARAMETER_INTEGER and number == number:
        other.integer_value = int(number)
    else:
        return None
    return other


def something(kind):
    """A value of a type of parameters, by its number."""
    return ParameterValue(
        type=kind,
        byte_array_value=[b"a"],
        bool_array_value=[True],
        integer_array_value=[1],
        double_array_value=[1.0],
        string_array_value=["a"],
    )


def unusable(name, value, row):
    """Values that a parameter must refuse, each with a part of the reason."""
    fixed = "fixed" in row[2]
    if not name.removeprefix("tip_").startswith("zone_"):
        yield ParameterValue(), "cannot be deleted"
    yield ParameterValue(type=99), "has a value of type 99"
    for kind in range(1, 10):
        if kind != value.type and (kind, value.type) not in TAKEN_AS_NUMBERS:
            yield something(kind), "read-only" if fixed else WRONG_TYPE
    if fixed:
        yield value, "read-only"
        return
    nan = number_like(value, float("nan"))
    if nan is not None and name not in FREE_ANGLES:
        yield nan, NO_NUMBER
    if "…" in row[2]:
        low, high = map(float, row[2].split(";")[0].split("…"))
        for number in (low - 1e-3 * (high - low), 2.0 * high, float("inf"), float("-inf")):
            yield number_like(value, number), BEYOND_RANGE


@pytest.mark.parametrize("node", NODES)
def test_each_parameter_refuses_what_is_no_value_of_it_and_keeps_its_own(arm, node):
    before = arm.values_of(node)
    assert set(before) - OF_ROS == set(PARAMETERS[node])
    given = [
        (Parameter(name=name, value=value), part)
        for name, row in PARAMETERS[node].items()
        for value, part in unusable(name, before[name], row)
    ]
    given.append((Parameter(name="nobody"), "there is no parameter 'nobody'"))
    results = []
    for first in range(0, len(given), MOST_CHANGES):
        changes = [change for change, _ in given[first : first + MOST_CHANGES]]
        answer = arm.ask_node(SetParameters, f"{node}/set_parameters", parameters=changes)
        results.extend(answer.results)
    for (change, part), result in zip(given, results, strict=True):
        assert not result.successful, change
        assert re.search(part, result.reason), (change, result.reason)
        assert 10 < len(result.reason) < 500, (change, result.reason)
    assert repr(arm.values_of(node)) == repr(before)


BROKEN_PLANNER = """
import sys
from mhsb_planner.ros import planner_node

class Broken(planner_node.PlannerNode):
    def _on_reference(self, heard, info):
        if self.get_parameter("goal_via_tolerance").value == 1.5:
            raise ZeroDivisionError("broken on purpose")
        super()._on_reference(heard, info)

planner_node.PlannerNode = Broken
sys.exit(planner_node.main())
"""


def test_the_arm_is_stopped_in_motion_if_what_watches_its_plan_fails(
    observer, start_process, start_simulator
):
    start_simulator()
    planner = start_process(sys.executable, "-c", BROKEN_PLANNER)
    planner.wait_for("ready", 180.0)
    observer.until(lambda: observer.is_matched and len(observer.references) > 2)
    verdict = observer.request_verdict(0.6, -0.4)
    observer.until_in_force(verdict)
    observer.until(lambda: speed(observer.measured[-1]) > 0.05)
    assert observer.set_parameter(names.PLANNER_NODE, "goal_via_tolerance", 1.5)[0]
    planner.wait_for("the arm is to stop: the topic /reference has failed 3 times in a row")
    observer.until(lambda: speed(observer.references[-1].state) == 0.0, 3.0)
    observer.serve(0.5)
    assert speed(observer.references[-1].state) == 0.0
    assert speed(observer.measured[-1]) < 0.02, "of the noise of its sensors"
    tip = observer.machine.tip_position(observer.measured[-1].position)
    assert float(abs(tip - (0.6, -0.4)).max()) > 0.05, "the arm went on to its goal"
    assert observer.set_parameter(names.PLANNER_NODE, "goal_via_tolerance", 0.01)[0]
    observer.serve(1.0)
    verdict = observer.request_verdict(0.6, 0.1)
    assert observer.ending_of(verdict).outcome is Outcome.REACHED


def speed(state):
    """Largest speed of a joint, measured or of the reference [rad/s]."""
    return float(abs(state.velocity).max())


def test_a_clock_with_negative_seconds_is_logged_and_the_nodes_go_on(
    observer, start_planner, start_simulator
):
    use_sim_time = ("--ros-args", "-p", "use_sim_time:=true")
    nodes = {
        "mhsb_planner": start_planner(*use_sim_time),
        "mhsb_sim": start_simulator(*use_sim_time),
    }
    clock = observer.create_publisher(Clock, "/clock", qos.CLOCK)
    observer.until(lambda: clock.get_subscription_count() == 2)

    def has_reported(name: str) -> bool:
        clock.publish(Clock(clock=Time(sec=-5)))  # best effort: one may be lost
        return "(fault 1; the node goes on)" in nodes[name].output

    for name in nodes:
        observer.until(lambda each=name: has_reported(each))
    clock.publish(Clock(clock=Time(sec=9)))
    for name, child in nodes.items():
        assert child.process.poll() is None
        assert observer.ask_node(ListParameters, f"{name}/list_parameters").result.names


def test_a_deleted_zone_is_no_zone_and_no_other_parameter_can_be_deleted(arm):
    where = 0.6, 0.1
    assert arm.set_parameter("mhsb_planner", "zone_circles", (*where, 0.1))[0]
    assert arm.request_verdict(*where).code is Verdict.ZONE
    assert arm.set_value("mhsb_planner", "zone_circles", ParameterValue()) == (True, "")
    assert arm.request_verdict(*where).code is Verdict.OK
    taken, reason = arm.set_value("mhsb_planner", "payload", ParameterValue())
    assert (taken, reason) == (False, "payload cannot be deleted; set it to another value")
    assert arm.set_parameter("mhsb_planner", "zone_circles", (*where, 0.1))[0]
