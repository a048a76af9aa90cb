"""The node in this process, on a system whose clock is set while it runs.

It simulates in real time, and so is no test of the package: those run at a low priority.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS
from mhsb_msgs_py import reference, sim_status, topics
from mhsb_msgs_py.node_process import run_ros, serve_node, spin_until
from mhsb_sim.ros.sim_node import SimNode


class Served:
    """A simulator node, and what it publishes."""

    def __init__(self, executor: Any, node: SimNode) -> None:
        self.executor, self.node = executor, node
        self.references: list[reference.Reference] = []
        self.sentences: list[str] = []
        names = node._machine.joint_names
        for topic, hear in (
            (topics.REFERENCE, lambda m: self.references.append(reference.decode(m, names))),
            (topics.DIAGNOSTICS, self._on_diagnostics),
        ):
            node.create_subscription(topic.message, topic.name, hear, topic.qos)

    def _on_diagnostics(self, message: Any) -> None:
        for report in sim_status.decode(message):
            self.sentences.append(report.sentence)

    def until(self, condition: Callable[[], bool]) -> None:
        assert spin_until(self.executor, condition, 15.0), self.sentences[-5:]


@pytest.fixture
def served(ros_domain: int, machine: Machine) -> Iterator[Served]:
    with run_ros([]), serve_node(SimNode) as (executor, node):
        served = Served(executor, node)
        served.until(lambda: len(served.references) > 5)
        yield served


@pytest.mark.parametrize("jump", [-3600, -2, 2, 3600])
def test_the_systems_clock_set_back_or_ahead_changes_nothing_but_is_told(
    served: Served, monkeypatch: pytest.MonkeyPatch, jump: int
) -> None:
    systems = time.time_ns
    monkeypatch.setattr(time, "time_ns", lambda: systems() + jump * SECOND_NS)
    side = "behind" if jump > 0 else "ahead of"
    served.until(lambda: any(f"s {side} the system's clock" in each for each in served.sentences))
    heard = len(served.references)
    served.until(lambda: len(served.references) > heard + 20)
    steps = np.diff([each.stamp_ns for each in served.references])
    assert steps.min() > 0
    assert steps.max() < SECOND_NS

    served.node._restart_arm()  # as ~/reset does: it takes the system's time anew
    served.until(lambda: served.sentences[-1] == "running")
    served.references.clear()
    served.until(lambda: len(served.references) > 20)
    assert abs(served.references[-1].stamp_ns - time.time_ns()) < SECOND_NS
