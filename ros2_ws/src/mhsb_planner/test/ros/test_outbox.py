"""Outbox of the planner node: answers to requests that wait for another one."""

import gc
import threading
import weakref
from collections.abc import Iterator

import pytest
from rclpy.context import Context
from rclpy.node import Node

from mhsb_model.errors import MhsbError
from mhsb_planner.ros.outbox import RosOutbox


class WaitingRequest:
    """Request whose plan is made when it is let go.

    Attributes:
        begun: Set when the worker has begun the plan.
        let_go: Set to let the worker finish.
    """

    def __init__(self) -> None:
        self.begun, self.let_go = threading.Event(), threading.Event()

    def make_plan(self, replanner: object) -> object:
        self.begun.set()
        assert self.let_go.wait(30.0)
        return replanner


class StepTable:
    """Stands for the large tables of a search."""


class FailingRequest:
    """Request without a plan, whose error and frame hold each other.

    Attributes:
        table: Weak reference to the table that the frame holds.
    """

    def make_plan(self, replanner: object) -> object:
        table = StepTable()
        self.table = weakref.ref(table)
        error = MhsbError("no path")
        raise error


@pytest.fixture
def no_automatic_collection() -> Iterator[None]:
    """Python collects no garbage by itself."""
    gc.disable()
    yield
    gc.enable()


@pytest.fixture
def outbox(ros_context: Context, machine) -> Iterator[RosOutbox]:
    node = Node("outbox", context=ros_context)
    made = RosOutbox(node, machine, "")
    made.start("a plan", lambda: None)
    yield made
    node.destroy_node()


def test_answers_come_in_the_order_of_the_requests(outbox):
    requests = [WaitingRequest(), WaitingRequest()]
    for request in requests:
        outbox.start_planning(request)
        request.let_go.set()
    assert requests[-1].begun.wait(30.0)
    outbox.close()
    assert list(outbox.take_answers()) == [(request, "a plan") for request in requests]


def test_closing_drops_waiting_requests_without_a_word(outbox, caplog):
    made, waiting = WaitingRequest(), WaitingRequest()
    outbox.start_planning(made)
    outbox.start_planning(waiting)
    assert made.begun.wait(30.0)
    threading.Timer(0.2, made.let_go.set).start()
    outbox.close()
    assert list(outbox.take_answers()) == [(made, "a plan")]
    assert not waiting.begun.is_set()
    assert caplog.text == ""


def test_tables_of_a_failed_plan_are_freed_with_the_next_plan(outbox, no_automatic_collection):
    failing, next_request = FailingRequest(), WaitingRequest()
    outbox.start_planning(failing)
    outbox.start_planning(next_request)
    assert next_request.begun.wait(30.0)
    assert [str(answer) for _, answer in outbox.take_answers()] == ["no path"]
    next_request.let_go.set()
    outbox.close()
    assert failing.table() is None
