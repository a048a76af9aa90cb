"""Random inputs at everything that reaches the nodes: no node ends or fails, and the next goal
works.

What they subscribe and serve is read off the running nodes; that docs/security.md names
the same is tested elsewhere.
"""

from __future__ import annotations

import importlib
import random
import re
import signal
import uuid
from collections import deque
from functools import partial
from pathlib import Path

import pytest
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy._rclpy_pybind11 import RCLError
from rclpy.node import Node
from rclpy.serialization import serialize_message
from std_srvs.srv import Trigger
from tests.support import spoiling

from mhsb_model.goal import Goal
from mhsb_model.verdict import Outcome, Verdict
from mhsb_msgs_py import goal_pose, qos, topics
from mhsb_msgs_py.guarded_executor import GuardedExecutor
from mhsb_msgs_py.node_process import serve_node, spin_until

NODES = "mhsb_planner", "mhsb_sim"
SAMPLE, WHOLE = 1_500, 100_000
AT_ONCE = 6
"""Messages without a look at their effect, fewer than the nodes' queues keep of one topic."""

PACE = 0.008  # s
CALLS = 0.2
"""Of all inputs, those that are calls of services."""

UNANSWERED = 60
"""Calls in flight; the next waits for the first of them."""

GROWTH = 24.0
"""Most that a node grows in memory from the first tenth of all inputs to the last [MiB]."""

OPTIONS = ("'", "{a: 1}", "2001-13-45", "[[[", "0x" + 900 * "f", "1.5", "table", "[1, 2, 3]", "~")

FAULT = re.compile(r"a fault in (?!the topic /clock).*")
"""What a node's log says of a callback that failed. rclpy itself fails for a strange /clock."""


def interface(type_name):
    """The class of a type that ROS writes as `std_msgs/msg/String`, or of an action's service."""
    package, kind, name = type_name.split("/")
    module = importlib.import_module(f"{package}.{kind}")
    if kind == "action":
        action, service = name.split("_")
        return getattr(getattr(module, action).Impl, f"{service}Service")
    return getattr(module, name)


class Stranger(Node):
    """Sends random messages to all topics of both nodes, and calls all their services.

    What is spoilt is what the nodes themselves have said last on a topic.
    """

    def __init__(self, arm, source):
        super().__init__("stranger")
        self.arm, self.source = arm, source
        self.calls = deque()
        self.goals = deque(maxlen=20)
        self.results = []
        self.sent = 0
        self.heard = {}
        self.publishers_of = {}
        self.clients_of = []
        for node in NODES:
            for name in sorted({*arm.topics_of(node), "/clock"} - set(self.heard)):
                self.listen_and_publish(name)
            for name, type_name in arm.services_of(node).items():
                kind = interface(type_name)
                client = self.create_client(kind, name, qos_profile=qos.SERVICE)
                self.clients_of.append((node, kind, client))
        self.values = {node: arm.values_of(node) for node in NODES}

    def listen_and_publish(self, name):
        known = {f"/{topic.name.removeprefix('/')}": topic for topic in topics.SUITE_TOPICS}
        topic = known[name]
        self.heard[name] = topic.message()
        listen = partial(self.keep, name)
        self.create_subscription(topic.message, name, listen, topic.qos)
        self.publishers_of[name] = self.create_publisher(topic.message, name, topic.qos)

    def keep(self, name, message):
        """Keep a message of the nodes, and one in ten of those spoilt before."""
        if self.sent == 0 or self.source.random() < 0.1:
            self.heard[name] = message

    def send(self):
        """Send one random message."""
        name = self.source.choice(list(self.publishers_of))
        message = self.heard[name]
        if name == "/goal_pose":
            message = goal_pose.encode(self.some_goal())
        spoilt = spoiling.damage_message(message, self.source, self.source.randint(0, 3))
        if self.source.random() < 0.3:
            spoilt = spoiling.damage_bytes(serialize_message(spoilt), self.source)
        try:
            self.publishers_of[name].publish(spoilt)
        except RCLError:  # more bytes than the middleware sends of a type of fixed size
            return
        self.sent += 1

    def call(self):
        """Call one random service with a random request."""
        node, kind, client = self.source.choice(self.clients_of)
        request = self.request(node, kind)
        answer = client.call_async(request)
        if client.srv_name.endswith("get_result"):
            self.results.append((request, answer))  # may take until its goal has ended
        else:
            self.calls.append((client.srv_name, answer))
        self.sent += 1

    def request(self, node, kind):
        source, names = self.source, list(self.values[node])
        some = [
            source.choice([*names, *spoiling.SPOILED_TEXTS]) for _ in range(source.randrange(4))
        ]
        if kind is Trigger:
            return kind.Request()
        if kind in (SetParameters, SetParametersAtomically):
            changes = [Parameter(name=name, value=self.value(node, name)) for name in some]
            return kind.Request(parameters=changes)
        if kind in (GetParameters, GetParameterTypes, DescribeParameters):
            return kind.Request(names=some)
        if kind is ListParameters:
            return kind.Request(prefixes=some, depth=source.randrange(2**64))
        return self.request_of_action(kind, some)

    def request_of_action(self, kind, some):
        """A request for a new goal, or about a goal, which in two of three cases was sent."""
        source, request = self.source, kind.Request()
        goal_id = list(uuid.UUID(int=source.getrandbits(128)).bytes)
        if self.goals and source.randrange(3):
            goal_id = source.choice(self.goals)
        if hasattr(request, "goal"):
            goal = request.goal
            goal.pose = goal_pose.encode(self.some_goal())
            goal.plan_only = bool(source.randrange(2))
            goal.options = [f"{name}:={source.choice(OPTIONS)}" for name in some]
            if source.randrange(2):
                goal.options = []
            request.goal = spoiling.damage_message(goal, source, source.randint(0, 2))
            self.goals.append(goal_id)
        if hasattr(request, "goal_info"):
            request.goal_info.goal_id.uuid = goal_id
        if hasattr(request, "goal_id"):
            request.goal_id.uuid = goal_id
        return request

    def some_goal(self):
        return Goal(0, self.source.uniform(0.2, 0.9), self.source.uniform(-0.7, 0.7))

    def value(self, node, name):
        """A parameter's value, half of the time of its own type, else of any, known or not."""
        source, declared = self.source, self.values[node].get(name)
        numbers = source.choices((*spoiling.SPOILED_FLOATS, 0.5), k=source.randrange(9))
        kind = source.choice((*range(10), 99, 255))
        return ParameterValue(
            type=declared.type if declared is not None and source.randrange(2) else kind,
            bool_value=bool(source.randrange(2)),
            integer_value=source.choice((0, 1, -1, 2**31, -(2**63), 2**63 - 1)),
            double_value=source.choice((*spoiling.SPOILED_FLOATS, 0.5)),
            string_value=source.choice(
                (*spoiling.SPOILED_TEXTS, "table", "main_pump", "coordinated")
            ),
            double_array_value=numbers,
            integer_array_value=[source.randrange(-5, 5) for _ in numbers],
            string_array_value=[source.choice(spoiling.SPOILED_TEXTS) for _ in numbers],
            bool_array_value=[True] * len(numbers),
            byte_array_value=[bytes([7])] * len(numbers),
        )

    def go_on(self, count):
        """Send and call until so many inputs have been given; every call is answered."""
        while self.sent < count:
            for _ in range(AT_ONCE):
                self.call() if self.source.random() < CALLS else self.send()
            spin_until(self.executor, lambda: False, PACE)
            while len(self.calls) > UNANSWERED or (self.calls and self.calls[0][1].done()):
                self.await_first_call()
        while self.calls:
            self.await_first_call()
        spin_until(self.executor, lambda: not self.unanswered(), 240.0)
        assert not self.unanswered()

    def await_first_call(self):
        name, answer = self.calls.popleft()
        assert spin_until(self.executor, answer.done, 60.0), name
        assert answer.result() is not None, name

    def unanswered(self):
        """Requests for results that have not been answered."""
        self.results = [(request, answer) for request, answer in self.results if not answer.done()]
        return [request for request, _ in self.results]


def memory(child):
    """Resident bytes of a process."""
    return 4096 * int(Path(f"/proc/{child.process.pid}/statm").read_text().split()[1])


def set_back(arm, before):
    """Set all parameters to what they were before, and the arm to its start."""
    for node, values in before.items():
        now = arm.values_of(node)
        back = [Parameter(name=n, value=v) for n, v in values.items() if repr(v) != repr(now[n])]
        if not back:
            continue
        service = f"{node}/set_parameters_atomically"  # some must not be above others
        result = arm.ask_node(SetParametersAtomically, service, parameters=back).result
        assert result.successful, result.reason
    for service in ("clear_faults", "reset"):
        assert arm.call(f"mhsb_sim/{service}").success, service


def executes_goals(arm):
    """Have the arm reach two places."""
    for goal in ((0.6, 0.1), (0.55, 0.2)):
        verdict = arm.request_verdict(*goal)
        assert verdict.code in (Verdict.OK, Verdict.AT_GOAL), verdict.sentence
        if verdict.code is Verdict.OK:
            ending = arm.ending_of(verdict)
            assert ending.outcome is Outcome.REACHED, ending.sentence


def give(stranger, children, count):
    """Give so many random inputs; the nodes do not end, and are no larger in the end."""
    spin_until(stranger.executor, lambda: False, 1.0)
    stranger.go_on(count // 10)
    early = {name: memory(child) for name, child in children.items()}
    stranger.go_on(count)
    assert all(child.process.poll() is None for child in children.values())
    growth = {name: (memory(children[name]) - early[name]) / 2**20 for name in children}
    print(f"{stranger.sent} inputs, growth in MiB: {growth}")
    assert max(growth.values()) < GROWTH, growth


def fuzz(arm, nodes, seed, count):
    """Give so many random inputs; then the nodes live, have not failed, and execute goals."""
    children = dict(nodes("mhsb_sim", "mhsb_planner"))
    before = {node: arm.values_of(node) for node in NODES}
    with serve_node(partial(Stranger, arm, random.Random(seed)), GuardedExecutor) as (_, stranger):
        give(stranger, children, count)
    with serve_node(type(arm)) as (executor, fresh):  # which has heard nothing spoilt
        fresh.executor_of_tests = executor
        set_back(fresh, before)
        fresh.until(lambda: fresh.is_matched and len(fresh.references) > 2)
        fresh.serve(4.0)
        executes_goals(fresh)
    for name, child in children.items():
        assert child.stop(signal.SIGINT) == 0, child.output
        assert set(FAULT.findall(child.output)) == set(), name


@pytest.mark.timeout(600)
def test_a_sample_of_random_inputs_at_every_boundary_ends_no_node(arm, nodes, fresh_seed):
    fuzz(arm, nodes, fresh_seed, SAMPLE)


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_a_hundred_thousand_random_inputs_at_every_boundary_end_no_node(arm, nodes, fresh_seed):
    fuzz(arm, nodes, fresh_seed, WHOLE)
