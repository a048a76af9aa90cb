"""The simulator as a process, and plans sent to it on behalf of a planner, half by half."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from rclpy.duration import Duration
from tests.support.messages import encode_schedule, encode_trajectory
from trajectory_msgs.msg import JointTrajectory

from mhsb_model.arm_reports import HandOverReport
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, MotionState, Trajectory, quintic_hermite
from mhsb_model.types import FloatArray
from mhsb_msgs_py import stamps, topics

SPACING_NS = SECOND_NS // 50
POINTS = 50
BOOSTED = (1, 1, 1)
"""With which the suite's arm holds and follows whatever these tests ask of it."""

Halves = tuple[JointTrajectory, JointTrajectory]


class Commander:
    """Publishes halves of plans; `observer` hears what the simulator says of them."""

    def __init__(self, observer: Any) -> None:
        self.observer = observer
        self.trajectories, self.schedules = self.publishers = [
            observer.create_publisher(topic.message, topic.name, topic.qos)
            for topic in (topics.JOINT_TRAJECTORY, topics.MODE_COMMANDS)
        ]
        observer.until(lambda: all(p.get_subscription_count() == 1 for p in self.publishers))
        observer.until(lambda: len(observer.references) > 0)

    def plan(self, shift: float = 0.0, modes: tuple[int, ...] = (0, 0, 0)) -> Halves:
        """A plan that holds the present reference, or stands beside it by `shift` [rad]."""
        path = np.tile(self._latest().state.position + shift, (POINTS, 1))
        zero = np.zeros_like(path)
        return self.halves(self._latest().stamp_ns, SPACING_NS, (path, zero, zero), modes)

    def move(
        self, by: FloatArray, duration: float = 6.0, wait: float = 0.8, stamp_ns: int | None = None
    ) -> Halves:
        """A plan that holds for `wait` [s] and then turns the joints by `by` [rad]."""
        latest = self._latest()
        start = latest.state.position
        time = np.linspace(0.0, duration, 1 + round(duration / 0.02))
        end = MotionState.at_rest(start + by)
        zero = np.zeros(3)
        moving = quintic_hermite(
            time[:, None],
            np.array([[duration]]),
            (start, zero, zero),
            (end.position, end.velocity, end.acceleration),
        )
        rest = round(wait / 0.02)
        arrays = [
            np.vstack([np.tile(first, (rest, 1)), values])
            for first, values in zip((start, zero, zero), moving, strict=True)
        ]
        arrays[1][-1] = 0.0
        stamp = latest.stamp_ns if stamp_ns is None else stamp_ns
        return self.halves(stamp, SPACING_NS, tuple(arrays), BOOSTED)

    def halves(
        self,
        stamp_ns: int,
        spacing_ns: int,
        arrays: tuple[FloatArray, ...],
        modes: tuple[int, ...],
    ) -> Halves:
        """Messages of a plan whose points stand `spacing_ns` apart."""
        machine = self.observer.machine
        offsets = spacing_ns * np.arange(len(arrays[0]))
        planned = Trajectory(stamp_ns, offsets, *arrays)
        schedule = ModeSchedule(stamp_ns, np.array([0]), np.array([modes]))
        return (
            encode_trajectory(planned, machine.joint_names),
            encode_schedule(schedule, machine.actuator_names),
        )

    def send(self, halves: Halves, once_received: Duration | None = None) -> int:
        """Send both halves; their stamp.

        once_received: how long the second half may wait until the first has arrived: one of many
                       points is longer under way than a half waits for the other
        """
        for publisher, message in zip(self.publishers, halves, strict=True):
            publisher.publish(message)
            if once_received is not None:
                assert publisher.wait_for_all_acked(once_received)
        return stamps.from_time(halves[0].header.stamp)

    def reports(self, stamp_ns: int) -> list[HandOverReport]:
        """All that the simulator has said of a stamp."""
        return [each for each in self.observer.hand_overs if each.plan_stamp_ns == stamp_ns]

    def outcome(self, stamp_ns: int) -> HandOverReport:
        """Wait for what the simulator says of a stamp."""
        self.observer.until(lambda: self.reports(stamp_ns))
        return self.reports(stamp_ns)[0]

    def outcome_of(self, halves: Halves) -> HandOverReport:
        """Send both halves, wait for what the simulator says of them."""
        return self.outcome(self.send(halves))

    def apply(self, halves: Halves) -> None:
        """Send both halves; fails where the simulator does not apply them."""
        report = self.outcome_of(halves)
        assert report.outcome == "applied", report.sentence

    def _latest(self) -> Any:
        """A reference that is newer than any before, so that stamps increase."""
        heard = len(self.observer.references)
        self.observer.until(lambda: len(self.observer.references) > heard + 2)
        return self.observer.references[-1]


@pytest.fixture
def commander(observer: Any, simulator: Any) -> Commander:
    """Somebody who sends plans to that simulator."""
    return Commander(observer)


@pytest.fixture
def commander_of() -> type[Commander]:
    """Commander(observer), for a simulator that a test has started itself."""
    return Commander
