"""A node outlives faults of its callbacks: each is recorded and answered, and the next works."""

from __future__ import annotations

import math
import threading
import time
import warnings

import pytest
from rcl_interfaces.msg import (
    FloatingPointRange,
    Parameter,
    ParameterDescriptor,
    ParameterType,
    ParameterValue,
    SetParametersResult,
)
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.clock import Clock as NodeClock
from rclpy.clock import ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter as NodeParameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Int32
from std_srvs.srv import Trigger

from mhsb_model.errors import MhsbError
from mhsb_msgs_py import qos
from mhsb_msgs_py.faults import IN_A_ROW_TO_STOP, Faults
from mhsb_msgs_py.guarded_executor import MOST_CHANGES, GuardedExecutor
from mhsb_msgs_py.node_process import run_ros, serve_node, spin_until

BAD = 13


class Frail(Node):
    """A node whose callbacks fail when they meet BAD, and which talks to itself."""

    deletable_parameters = frozenset({"kept"})

    def __init__(self) -> None:
        super().__init__("frail")
        self.stops = 0
        self.faults = Faults(self, stop=self.count_stop)
        self.taken: list[object] = []
        self.declare_parameter("number", 1)
        self.declare_parameter("kept", 1)
        self.add_on_set_parameters_callback(self.check)
        self.add_post_set_parameters_callback(self.apply)
        self.numbers = self.create_publisher(Int32, "numbers", qos.DEFAULT)
        self.subscription_of_numbers = self.create_subscription(
            Int32, "numbers", self.on_number, qos.DEFAULT
        )
        self.create_service(Trigger, "~/plain", self.fail)
        self.create_service(Trigger, "~/later", self.fail_later)
        self.condition = self.create_guard_condition(self.fail_at_once)

    def count_stop(self) -> None:
        self.stops += 1

    def on_number(self, message: Int32) -> None:
        self.refuse_bad(message.data)
        self.taken.append(message.data)

    def fail_at_once(self) -> None:
        self.refuse_bad(BAD)

    def fail(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.refuse_bad(BAD)
        return response

    async def fail_later(
        self, request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        self.refuse_bad(BAD)
        return response

    def check(self, changes: list[NodeParameter]) -> SetParametersResult:
        for change in changes:
            if change.name == "number":
                self.refuse_bad(change.value)
        return SetParametersResult(successful=True)

    def apply(self, changes: list[NodeParameter]) -> None:
        for change in changes:
            if change.value == 2 * BAD:
                raise OverflowError("cannot be applied")

    @staticmethod
    def refuse_bad(number: object) -> None:
        if number == BAD:
            raise ZeroDivisionError("an unlucky number")


class Pair:
    """A frail node and the executor that serves it."""

    def __init__(self, executor: GuardedExecutor, node: Frail) -> None:
        self.executor, self.node = executor, node

    def until(self, condition) -> None:
        assert spin_until(self.executor, condition, 10.0)

    def say(self, *numbers: int) -> None:
        before = len(self.node.taken) + self.node.faults.count
        for count, number in enumerate(numbers, before + 1):
            self.node.numbers.publish(Int32(data=number))
            self.until(lambda c=count: len(self.node.taken) + self.node.faults.count >= c)

    def call(self, kind, name, **fields):
        client = self.node.create_client(kind, name)
        self.until(client.service_is_ready)
        answer = client.call_async(kind.Request(**fields))
        self.until(answer.done)
        return answer.result()

    def set(self, *changes, kind=SetParameters):
        parameters = [
            Parameter(name=name, value=ParameterValue(type=type_, integer_value=value))
            for name, type_, value in changes
        ]
        several = kind is SetParameters
        name = "set_parameters" if several else "set_parameters_atomically"
        return self.call(kind, f"frail/{name}", parameters=parameters)

    def value(self, name):
        return self.node.get_parameter(name).value


@pytest.fixture
def frail(ros_domain):
    with run_ros([]), serve_node(Frail, GuardedExecutor) as (executor, node):
        pair = Pair(executor, node)
        pair.until(lambda: node.numbers.get_subscription_count() == 1)
        yield pair


def test_a_topic_that_fails_once_is_recorded_with_its_traceback_and_takes_the_next_message(
    frail, capfd
):
    frail.say(1, BAD, 2, BAD, 3)
    assert frail.node.taken == [1, 2, 3]
    assert frail.node.faults.count == 2
    sentence = "a fault in the topic /numbers: ZeroDivisionError: an unlucky number"
    assert frail.node.faults.last == sentence
    log = capfd.readouterr().err
    assert log.count("Traceback") == log.count(sentence) == 1, "one of a kind, for some time"
    assert 'raise ZeroDivisionError("an unlucky number")' in log


def test_a_message_that_cannot_be_unpacked_does_not_occupy_the_node_for_good(frail):
    frail.node.subscription_of_numbers.msg_type = int  # rclpy fails while it takes the message
    frail.say(4)
    assert frail.node.faults.count >= 1
    assert frail.node.taken == []
    frail.node.subscription_of_numbers.msg_type = Int32
    frail.until(lambda: frail.node.taken == [4])


@pytest.mark.parametrize("service", ["plain", "later"])
def test_whoever_calls_a_service_that_fails_gets_an_answer(frail, service):
    answer = frail.call(Trigger, f"frail/{service}")
    assert not answer.success
    assert answer.message.startswith(f"a fault in the service /frail/{service}: ZeroDivisionError")
    assert frail.node.faults.count == 1


def test_a_client_that_is_discovered_late_gets_its_answer_all_the_same(frail, monkeypatch):
    service = next(each for each in frail.node.services if each.service_name == "/frail/plain")
    attempts, send = [], service.send_response

    def send_from_the_third_attempt(response, header):
        attempts.append(header)
        if len(attempts) < 3:
            warnings.warn("failed to send response (timeout)", RuntimeWarning, stacklevel=1)
        else:
            send(response, header)

    monkeypatch.setattr(service, "send_response", send_from_the_third_attempt)
    assert not frail.call(Trigger, "frail/plain").success
    assert len(attempts) == 3
    assert frail.node.faults.count == 1, "the callback is not called again"


def test_a_client_that_can_never_be_answered_is_given_up_and_others_are_served_meanwhile(
    frail, capfd
):
    not_of_answers = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    deaf = frail.node.create_client(Trigger, "frail/plain", qos_profile=not_of_answers)
    heard = frail.node.create_client(Trigger, "frail/later")
    frail.until(heard.service_is_ready)
    deaf.call_async(Trigger.Request())
    frail.until(lambda: frail.node.faults.count == 1)
    frail.until(heard.call_async(Trigger.Request()).done)
    log = []

    def is_told() -> bool:
        log.append(capfd.readouterr().err)
        return "an answer of the service /frail/plain could not be sent" in log[-1]

    frail.until(is_told)
    assert frail.node.faults.count == 2, "each callback was called once"
    assert not list(frail.node.timers)


def test_a_guard_condition_and_a_timer_that_fail_are_recorded_each_time(frail):
    for count in (1, 2):
        frail.node.condition.trigger()
        frail.until(lambda count=count: frail.node.faults.count == count)
    steady = NodeClock(clock_type=ClockType.STEADY_TIME)
    timer = frail.node.create_timer(0.01, frail.node.fail_at_once, clock=steady)
    frail.until(lambda: frail.node.faults.count > 5)
    assert not timer.is_canceled()


def test_a_task_of_the_node_that_fails_is_recorded(frail):
    frail.executor.create_task(frail.node.fail_at_once)
    frail.until(lambda: frail.node.faults.count == 1)
    frail.say(6)
    assert frail.node.taken == [6]


def test_entities_are_gathered_once_for_a_callback(frail, monkeypatch):
    gathered, called = [], []
    get_nodes = frail.executor.get_nodes  # called each time that entities are gathered
    monkeypatch.setattr(frail.executor, "get_nodes", lambda: gathered.append(1) or get_nodes())
    steady = NodeClock(clock_type=ClockType.STEADY_TIME)
    frail.node.create_timer(0.01, lambda: called.append(1), clock=steady)
    frail.until(lambda: len(called) == 40)
    assert len(gathered) < 1.5 * len(called)


def test_a_task_of_another_thread_wakes_the_executor(frail):
    spin_until(frail.executor, lambda: False, 0.2)  # what comes with the node's start is served
    threading.Timer(0.3, frail.executor.create_task, [frail.node.taken.append, [3]]).start()
    begin = time.monotonic()
    while not frail.node.taken:
        frail.executor.spin_once(20.0)
    assert time.monotonic() - begin < 10.0


@pytest.mark.parametrize("kind", [SetParameters, SetParametersAtomically])
@pytest.mark.parametrize("value", [BAD, 2 * BAD])
def test_a_setting_that_fails_is_refused_and_the_node_keeps_what_it_had(frail, kind, value):
    answer = frail.set(("number", 2, value), kind=kind)
    result = answer.results[0] if kind is SetParameters else answer.result
    assert not result.successful
    assert result.reason.startswith("a fault in the service /frail/set_parameters")
    assert frail.value("number") == 1
    assert frail.set(("number", 2, 7)).results[0].successful
    assert frail.value("number") == 7


def test_of_several_settings_in_one_request_only_the_faulty_are_refused(frail):
    results = frail.set(("number", 2, BAD), ("number", 99, 0), ("nobody", 2, 1), ("number", 2, 5))
    reasons = [each.reason for each in results.results]
    assert [each.successful for each in results.results] == [False, False, False, True]
    assert reasons[1] == ("number has a value of type 99; types are 1 (bool) to 9 (array of texts)")
    assert reasons[2] == "there is no parameter 'nobody'"
    assert frail.value("number") == 5


def test_of_a_request_that_would_occupy_the_node_for_long_only_the_first_settings_are_made(frail):
    changes = [("number", 2, 100 + value) for value in range(MOST_CHANGES + 3)]
    results = frail.set(*changes).results
    assert [each.successful for each in results] == [True] * MOST_CHANGES + [False] * 3
    assert results[-1].reason.startswith(f"one request may set {MOST_CHANGES} parameters")
    assert frail.value("number") == 99 + MOST_CHANGES
    result = frail.set(*changes, kind=SetParametersAtomically).result
    assert (result.successful, result.reason) == (False, results[-1].reason)
    assert frail.value("number") == 99 + MOST_CHANGES


def test_only_parameters_whose_deletion_means_something_can_be_deleted(frail):
    results = frail.set(("number", 0, 0), ("use_sim_time", 0, 0), ("", 0, 0)).results
    assert [each.reason for each in results] == [
        "number cannot be deleted; set it to another value",
        "use_sim_time cannot be deleted; set it to another value",
        "there is no parameter ''",
    ]
    assert frail.value("number") == 1


def test_times_that_leave_no_room_for_later_stamps_are_recorded_and_time_goes_on(frail):
    assert frail.node.set_parameters([NodeParameter("use_sim_time", value=True)])[0].successful
    clock = frail.node.create_publisher(Clock, "/clock", qos.CLOCK)
    frail.until(lambda: clock.get_subscription_count() == 1)
    for seconds, nanoseconds in ((3, 0), (-5, 0), (2**31 - 1, 0), (4, 2**32 - 1), (9, 0)):
        message = Clock()
        message.clock.sec, message.clock.nanosec = seconds, nanoseconds
        clock.publish(message)
        spin_until(frail.executor, lambda: False, 0.2)
    assert frail.node.faults.count == 3
    assert frail.node.get_clock().now().nanoseconds == 9_000_000_000


def test_the_arm_is_stopped_if_what_watches_it_fails_three_times_in_a_row(frail):
    frail.node.faults.watch(frail.node.subscription_of_numbers)
    frail.say(BAD, BAD, 1, BAD, BAD)
    assert frail.node.stops == 0
    frail.say(*(BAD,) * (IN_A_ROW_TO_STOP - 2))
    assert frail.node.stops == 1
    frail.say(BAD, BAD)
    assert frail.node.stops == 1, "once a second"


def test_what_nobody_watches_by_never_stops_the_arm(frail):
    frail.say(*(BAD,) * 9)
    assert frail.node.stops == 0


def test_errors_that_are_to_end_the_node_pass(frail):
    frail.node.faults.ending_errors = (MhsbError,)

    def fail() -> None:
        raise MhsbError("the disk is full")

    frail.executor.create_task(fail)
    with pytest.raises(MhsbError, match="the disk is full"):
        spin_until(frail.executor, lambda: False, 5.0)


def test_an_exception_without_a_text_or_with_an_endless_one_makes_one_line(frail):
    class Silent(Exception):
        def __str__(self) -> str:
            raise RuntimeError

    assert frail.node.faults.record_fault("a test", Silent()) == (
        "a fault in a test: Silent; the log of frail says more"
    )
    long = frail.node.faults.record_fault("a test", ValueError("é\n" * 100_000))
    assert len(long) < 500
    assert "\n" not in long


@pytest.mark.parametrize(
    ("value", "sentence"),
    [
        (4e-5, "must be from 100000 to 5e+07 Pa (is 4e-05)"),
        (0.4, "must be from 100000 to 5e+07 Pa (is 0.4); in MPa? 0.4 MPa are 4e+05 Pa"),
        (-1.0, "must be from 100000 to 5e+07 Pa (is -1)"),
        (math.nan, "must be from 100000 to 5e+07 Pa (is nan)"),
    ],
)
def test_a_number_out_of_its_range_is_refused_with_the_range_and_a_unit_that_fits(
    frail, value, sentence
):
    bounds = [FloatingPointRange(from_value=1e5, to_value=5e7)]
    frail.node.declare_parameter(
        "pressure", 1e7, ParameterDescriptor(description="P_S [Pa]", floating_point_range=bounds)
    )
    content = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value)
    parameters = [Parameter(name="pressure", value=content)]
    [result] = frail.call(SetParameters, "frail/set_parameters", parameters=parameters).results
    assert (result.successful, result.reason) == (False, f"pressure {sentence}")
    assert frail.value("pressure") == 1e7
