"""Both nodes as processes, and a node that commands and observes them."""

from __future__ import annotations

import contextlib
import signal
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, ClassVar

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, ListParameters, SetParameters
from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node, NodeNameNonExistentError
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from std_srvs.srv import Trigger

from mhsb_model.arm_reports import HandOverReport, SimulatorReport
from mhsb_model.machine import load_machine
from mhsb_model.verdict import ExecutionReport, GoalVerdict
from mhsb_msgs_py import joint_state, reference, sim_status, stamps, topics
from mhsb_msgs_py.joint_state import JointSample
from mhsb_msgs_py.node_process import run_ros, serve_node, spin_until
from mhsb_msgs_py.reference import Reference
from mhsb_msgs_py.topics import Topic
from mhsb_planner.ros.goal_sender import GoalSender

OF_ROS = {"/parameter_events"}
"""What rclpy subscribes for itself."""

READY_TIMEOUT = 180.0
"""The first start of a node compiles its kernels [s]."""


STREAM_DEPTH = 1000
"""Messages of a stream that wait until they are taken: 10 s of the simulator's."""

POLLING_PERIOD = 0.02
"""Longest time between two looks at the streams while an observer waits [s]."""


class Unserved(CallbackGroup):
    """Callbacks that no executor calls: their messages wake none."""

    def can_execute(self, entity: object) -> bool:
        return False


class Stream:
    """A topic of a hundred messages a second, taken together whenever someone looks.

    An executor that is woken by each of them takes 1.2 ms for it, a quarter of a processor in all.
    """

    def __init__(self, node: Node, topic: Topic, decode: Callable[[Any], Any]) -> None:
        self._decode, self._message = decode, topic.message
        qos = QoSProfile(depth=STREAM_DEPTH, reliability=topic.qos.reliability)
        self._subscription = node.create_subscription(
            topic.message, topic.name, print, qos, callback_group=Unserved(), raw=True
        )
        self._waiting: list[bytes] = []
        self._decoded: list[Any] = []

    def take(self) -> None:
        """Take what has come from the middleware."""
        handle = self._subscription.handle
        with handle:
            while (taken := handle.take_message(self._message, True)) is not None:
                self._waiting.append(taken[0])

    def messages(self) -> list[Any]:
        """All that came since the list was cleared, decoded; the list itself."""
        self.take()
        waiting, self._waiting = self._waiting, []
        self._decoded += [self._decode(deserialize_message(raw, self._message)) for raw in waiting]
        return self._decoded


class Observer(GoalSender):
    """Sends goals and keeps what both nodes say."""

    def __init__(self) -> None:
        super().__init__()
        self.executor_of_tests: Any = None
        self.machine = load_machine()
        self.hand_overs: list[HandOverReport] = []
        self.simulator_reports: list[SimulatorReport] = []
        self._references, self._measured = (
            Stream(self, topic, partial(self._decode, codec))
            for topic, codec in ((topics.REFERENCE, reference), (topics.JOINT_STATES, joint_state))
        )
        self.in_force_ns: int | None = None
        self._parameters_before: dict[tuple[str, str], ParameterValue] = {}
        for topic, callback in (
            (topics.DIAGNOSTICS, self._on_diagnostics),
            (topics.PLAN_IN_FORCE, self._on_plan_in_force),
        ):
            self.create_subscription(topic.message, topic.name, callback, topic.qos)
        self.goal_publisher = self._goals

    @property
    def references(self) -> list[Reference]:
        """References that came since this list was cleared."""
        return self._references.messages()

    @property
    def measured(self) -> list[JointSample]:
        """Joint states that came since this list was cleared."""
        return self._measured.messages()

    def comes_true(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Serve until the condition holds, or a time [s] has passed; whether it holds."""

        def holds() -> bool:
            self._references.take()
            self._measured.take()
            return condition()

        end = time.monotonic() + timeout
        while (left := end - time.monotonic()) > 0.0:
            if spin_until(self.executor_of_tests, holds, min(left, POLLING_PERIOD)):
                return True
        return holds()

    def listeners_to_goals(self) -> set[bytes]:
        """Who hears goals; one that was killed stays among them for a while."""
        found = self.get_subscriptions_info_by_topic(topics.GOAL_POSE.name)
        return {bytes(each.endpoint_gid) for each in found}

    def hears_all_planners(self) -> bool:
        """Whether goals reach, and verdicts come from, all planners that the graph knows."""
        if self.subscriber_count < self.count_subscribers(topics.GOAL_POSE.name):
            return False
        return self._status.get_publisher_count() >= self.count_publishers(topics.PLAN_STATUS.name)

    def until(self, condition: Callable[[], bool], timeout: float = 15.0) -> None:
        """Serve until the condition holds; fails where it does not in time [s].

        The failure says what was heard last of verdicts, hand-overs and executions.
        """
        assert self.comes_true(condition, timeout), (
            f"not within {timeout} s, in force {self.in_force_ns}",
            list(self.verdicts.values())[-2:],
            self.hand_overs[-2:],
            list(self.executions.values())[-2:],
        )

    def serve(self, duration: float) -> None:
        """Serve for some time [s]."""
        self.comes_true(lambda: False, duration)

    def request_verdict(self, *place: float, timeout: float = 15.0) -> GoalVerdict:
        """Send a goal and wait for its verdict."""
        stamp_ns = self.send(*place)
        self.until(lambda: stamp_ns in self.verdicts, timeout)
        return self.verdicts[stamp_ns]

    def ask_message(self, message: PoseStamped) -> GoalVerdict:
        """Send a goal message as it is and wait for its verdict."""
        self.goal_publisher.publish(message)
        stamp_ns = stamps.from_time(message.header.stamp)
        self.until(lambda: stamp_ns in self.verdicts)
        return self.verdicts[stamp_ns]

    def ending_of(self, verdict: GoalVerdict, timeout: float = 40.0) -> ExecutionReport:
        """Wait for the end of an accepted goal's execution."""
        self.until(lambda: verdict.goal_stamp_ns in self.executions, timeout)
        return self.executions[verdict.goal_stamp_ns]

    def comes_into_force(self, verdict: GoalVerdict, timeout: float) -> bool:
        """Whether the arm executes a plan for the newest goal, which was accepted, in a time [s].

        The first plan, whose stamp the verdict tells, or one that was made again.
        """
        assert verdict.plan is not None
        stamp_ns = verdict.plan.plan_stamp_ns
        return self.comes_true(lambda: (self.in_force_ns or 0) >= stamp_ns, timeout)

    def until_in_force(self, verdict: GoalVerdict) -> None:
        """Wait until the arm executes an accepted goal's plan; says what became of it if not."""
        assert self.comes_into_force(verdict, 15.0), (self.hand_overs[-2:], self.executions)

    def call(self, service: str) -> Trigger.Response:
        """Call a Trigger service, such as `mhsb_sim/stop`."""
        return self.ask_node(Trigger, service)

    def set_parameter(
        self, node: str, name: str, value: float | str | tuple[float, ...]
    ) -> tuple[bool, str]:
        """Set a number, a text or numbers; whether they were taken, and the reason where not."""
        content = ParameterValue()
        if isinstance(value, str):
            content.type, content.string_value = ParameterType.PARAMETER_STRING, value
        elif isinstance(value, tuple):
            content.type, content.double_array_value = ParameterType.PARAMETER_DOUBLE_ARRAY, value
        else:
            content.type, content.double_value = ParameterType.PARAMETER_DOUBLE, value
        if (node, name) not in self._parameters_before:
            before = self.ask_node(GetParameters, f"{node}/get_parameters", names=[name])
            self._parameters_before[node, name] = before.values[0]
        return self.set_value(node, name, content)

    def set_parameters_back(self) -> None:
        """To what they were before this observer set them."""
        for (node, name), value in self._parameters_before.items():
            taken, reason = self.set_value(node, name, value)
            assert taken, reason

    def set_value(self, node: str, name: str, value: ParameterValue) -> tuple[bool, str]:
        """Set a parameter to a value of any type; whether it was taken, and the reason if not."""
        parameters = [Parameter(name=name, value=value)]
        result = self.ask_node(SetParameters, f"{node}/set_parameters", parameters=parameters)
        return result.results[0].successful, result.results[0].reason

    def services_of(self, node: str) -> dict[str, str]:
        """Types of a running node's services by their absolute names, once the graph shows it."""
        found: dict[str, str] = {}

        def shown() -> bool:
            with contextlib.suppress(NodeNameNonExistentError):
                given = self.get_service_names_and_types_by_node(node, "/")
                found.update((name, types[0]) for name, types in given)
            return f"/{node}/stop" in found

        self.until(shown)
        return found

    def topics_of(self, node: str) -> set[str]:
        """Absolute names of what a running node subscribes, rclpy's own topics excepted."""
        self.services_of(node)
        found = self.get_subscriber_names_and_types_by_node(node, "/")
        return {name for name, _ in found} - OF_ROS

    def values_of(self, node: str) -> dict[str, ParameterValue]:
        """Values of all parameters of a node by their names."""
        names = list(self.ask_node(ListParameters, f"{node}/list_parameters").result.names)
        answer = self.ask_node(GetParameters, f"{node}/get_parameters", names=names)
        return dict(zip(names, answer.values, strict=True))

    def ask_node(self, kind: Any, service: str, **fields: Any) -> Any:
        """Call a service of any type with these fields of its request; the response."""
        client = self.create_client(kind, service)
        self.until(client.service_is_ready)
        future = client.call_async(kind.Request(**fields))
        self.until(future.done)
        self.destroy_client(client)
        return future.result()

    def largest_reference_step(self) -> float:
        """Largest |q(t + 10 ms) − q(t) − 10 ms (q̇(t) + q̇(t + 10 ms))/2| of the reference [rad].

        A reference without jumps stays within what its acceleration allows, far below 1 mrad.
        """
        worst = 0.0
        for before, after in zip(self.references, self.references[1:], strict=False):
            h = (after.stamp_ns - before.stamp_ns) / 1e9
            if 0.0 < h < 0.05:
                mean = (before.state.velocity + after.state.velocity) / 2
                step = after.state.position - before.state.position - h * mean
                worst = max(worst, float(np.abs(step).max()))
        return worst

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for report in sim_status.decode(message):
            kept = self.hand_overs if isinstance(report, HandOverReport) else self.simulator_reports
            kept.append(report)

    def _decode(self, codec: Any, message: Any) -> Any:
        """Decode a message by the joints of `self.machine`, which a test may have replaced."""
        return codec.decode(message, self.machine.joint_names)

    def _on_plan_in_force(self, message: Time) -> None:
        self.in_force_ns = stamps.from_time(message)


@pytest.fixture
def observer(ros_domain: int) -> Iterator[Observer]:
    """An observer in this run's ROS domain."""
    with run_ros([]), serve_node(Observer) as (executor, node):
        node.executor_of_tests = executor
        yield node


@pytest.fixture
def start_planner(start_fork: Callable[..., Any]) -> Callable[..., Any]:
    """Function (arguments...) that starts a planner and waits until it is ready."""

    def run(*arguments: object) -> Any:
        child = start_fork("mhsb_planner", "planner_node", *arguments)
        child.wait_for("ready", READY_TIMEOUT)
        return child

    return run


@pytest.fixture
def start_simulator(start_fork: Callable[..., Any]) -> Callable[..., Any]:
    """Function (arguments...) that starts a simulator and waits until it is ready."""

    def run(*arguments: object) -> Any:
        child = start_fork("mhsb_sim", "sim_node", *arguments)
        child.wait_for("ready", READY_TIMEOUT)
        return child

    return run


class Nodes:
    """Nodes with default settings that go on from test to test, as long as each needs them.

    Which spares most tests the start of their processes; what it is to start and to end is the
    subject of others. After a test that fails they are started anew.
    """

    EXECUTABLES: ClassVar = {"mhsb_sim": "sim_node", "mhsb_planner": "planner_node"}

    def __init__(self) -> None:
        self.children: dict[str, Any] = {}

    def serve(self, wanted: set[str], fork_of: Callable[..., Any], observer: Observer) -> None:
        """Have these run, ready, at rest in the start posture, and no others."""
        self.end(set(self.children) - wanted)
        going_on = set(self.children)
        for package in wanted - going_on:
            self.children[package] = fork_of(package, self.EXECUTABLES[package])
        for child in self.children.values():
            child.wait_for("ready", READY_TIMEOUT)
        if "mhsb_sim" in going_on:
            assert observer.call("mhsb_sim/reset").success
            answered_ns = time.time_ns()  # plans that go by the time before are refused
            observer.until(
                lambda: observer.references and observer.references[-1].stamp_ns > answered_ns
            )
            observer.references.clear()
        observer.until(lambda: len(observer.references) > 2 and observer.in_force_ns == 0)

    def end(self, packages: set[str]) -> None:
        """End by SIGINT, which must be clean; what a test has ended itself is its own."""
        ended = [self.children.pop(package) for package in packages & set(self.children)]
        for child in ended:
            if child.process.poll() is None:
                assert child.stop(signal.SIGINT) == 0, child.output
                assert "Traceback" not in child.output

    def kill(self) -> None:
        """Whatever they are at."""
        for child in self.children.values():
            child.end_if_alive()
        self.children.clear()


NODES = Nodes()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Bring tests that share both nodes together, then those that share the simulator alone."""
    items.sort(key=lambda item: [each in item.fixturenames for each in ("simulator", "nodes")])


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> None:
    """Nodes that the next test does not use would take its time, or its names."""
    if nextitem is None or "nodes" not in nextitem.fixturenames:
        NODES.end(set(NODES.children))


def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> None:
    """What has happened to nodes in a test that failed is unknown."""
    if call.excinfo is not None:
        NODES.kill()


@pytest.fixture
def nodes(observer: Observer, fork_of: Callable[..., Any]) -> Iterator[Callable[..., Any]]:
    """Function (packages...) that has these nodes run, and no others; their `Child`s by package."""

    def serve(*packages: str) -> dict[str, Any]:
        NODES.serve(set(packages), fork_of, observer)
        return NODES.children

    yield serve
    if any(child.process.poll() is not None for child in NODES.children.values()):
        NODES.kill()
    elif NODES.children:
        observer.set_parameters_back()


@pytest.fixture
def arm(observer: Observer, nodes: Callable[..., Any]) -> Observer:
    """Both nodes running and heard."""
    nodes("mhsb_sim", "mhsb_planner")
    observer.until(lambda: observer.is_matched)
    return observer


@pytest.fixture
def simulator(nodes: Callable[..., Any]) -> Any:
    """The simulator running; its process."""
    return nodes("mhsb_sim")["mhsb_sim"]
