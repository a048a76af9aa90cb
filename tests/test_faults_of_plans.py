"""Plans that come in halves, twice, or out of order, from a node in the planner's place.

However they come, the newest complete one is followed, the reference never jumps, and of each
plan one report tells what became of it.
"""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from tests.support.messages import encode_schedule, encode_trajectory

from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, MotionState, Trajectory, quintic_hermite
from mhsb_msgs_py import topics

SPACING_NS = SECOND_NS // 50
HOLD = 2.0  # s
MOVE = np.array([0.05, -0.05, 0.05])
"""From the start posture, slowly [rad]."""


class Sender:
    """In the planner's place."""

    def __init__(self, observer):
        self.observer = observer
        self.publishers = {
            topic: observer.create_publisher(topic.message, topic.name, topic.qos)
            for topic in (topics.JOINT_TRAJECTORY, topics.MODE_COMMANDS)
        }
        observer.until(
            lambda: all(each.get_subscription_count() == 1 for each in self.publishers.values())
        )
        observer.until(lambda: len(observer.references) > 0)

    def move(self, share=1.0, duration=4.0):
        """Both halves of a plan that holds, long enough to come in time, and then moves."""
        self.observer.until(lambda: not self.observer.references[-1].state.velocity.any())
        latest, machine = self.observer.references[-1], self.observer.machine
        count = round((HOLD + duration) * 50) + 1
        time = np.clip(np.arange(count) / 50 - HOLD, 0.0, duration)[:, None]
        states = quintic_hermite(
            time,
            np.array([[duration]]),
            still(latest.state.position),
            still(latest.state.position + share * MOVE),
        )
        stamp_ns = latest.stamp_ns
        path = Trajectory(stamp_ns, SPACING_NS * np.arange(count), *states)
        schedule = ModeSchedule(stamp_ns, np.array([0]), np.zeros((1, 3), np.uint8))
        return Plan(
            stamp_ns,
            encode_trajectory(path, machine.joint_names),
            encode_schedule(schedule, machine.actuator_names),
        )

    def trajectory(self, plan):
        self.publishers[topics.JOINT_TRAJECTORY].publish(plan.path)

    def modes(self, plan):
        self.publishers[topics.MODE_COMMANDS].publish(plan.schedule)

    def told(self, plan):
        """Outcomes and reasons that were told of a plan."""
        reports = [r for r in self.observer.hand_overs if r.plan_stamp_ns == plan.stamp_ns]
        return [(report.outcome, report.reason) for report in reports]

    def until_told(self, plan):
        self.observer.until(lambda: self.told(plan))
        return self.told(plan)[0]


class Plan:
    """Both halves of a plan as messages."""

    def __init__(self, stamp_ns, path, schedule):
        self.stamp_ns, self.path, self.schedule = stamp_ns, path, schedule


def still(position):
    at_rest = MotionState.at_rest(position)
    return at_rest.position, at_rest.velocity, at_rest.acceleration


@pytest.fixture
def sender(observer, simulator):
    yield Sender(observer)
    assert observer.largest_reference_step() < 1e-3
    told = Counter(report.plan_stamp_ns for report in observer.hand_overs)
    assert set(told.values()) <= {1}, observer.hand_overs


def test_the_order_of_the_halves_does_not_matter(observer, sender):
    plan = sender.move()
    sender.modes(plan)
    sender.trajectory(plan)
    assert sender.until_told(plan)[0] == "applied"
    observer.until(lambda: observer.in_force_ns == plan.stamp_ns)


@pytest.mark.parametrize("lost", ["trajectory", "modes"])
def test_half_a_plan_moves_nothing_and_is_told_as_incomplete(observer, sender, lost):
    plan = sender.move()
    (sender.modes if lost == "trajectory" else sender.trajectory)(plan)
    assert sender.until_told(plan) == ("dropped", "incomplete")
    observer.serve(0.5)
    assert observer.in_force_ns == 0
    assert not observer.references[-1].state.velocity.any()
    whole = sender.move()
    sender.trajectory(whole)
    sender.modes(whole)
    assert sender.until_told(whole)[0] == "applied"


def test_a_plan_that_comes_twice_is_followed_once(observer, sender):
    plan = sender.move()
    for _ in range(3):
        sender.trajectory(plan)
        sender.modes(plan)
    assert sender.until_told(plan)[0] == "applied"
    observer.serve(1.0)  # in which copies that came later would be told of
    sender.trajectory(plan)
    sender.modes(plan)
    observer.serve(1.0)
    assert observer.in_force_ns == plan.stamp_ns
    assert len(sender.told(plan)) == 1


def test_of_two_plans_whose_halves_are_mixed_the_newer_is_followed(observer, sender):
    # Halves go by topics of their own: nobody knows whether the older pair is complete first.
    older = sender.move(share=0.5)
    observer.until(lambda: observer.references[-1].stamp_ns > older.stamp_ns)
    newer = sender.move()
    assert newer.stamp_ns > older.stamp_ns
    sender.trajectory(older)
    sender.trajectory(newer)
    sender.modes(older)
    sender.modes(newer)
    assert sender.until_told(newer)[0] == "applied"
    assert sender.until_told(older)
    observer.until(lambda: observer.in_force_ns == newer.stamp_ns)
    observer.until(lambda: observer.in_force_ns == 0, 10.0)
    start = np.array(observer.machine.config.simulation.start_posture)
    np.testing.assert_allclose(observer.references[-1].state.position, start + MOVE, atol=1e-9)


def test_an_older_plan_that_comes_late_does_not_disturb_the_newer_one(observer, sender):
    older = sender.move(share=0.5)
    observer.until(lambda: observer.references[-1].stamp_ns > older.stamp_ns)
    newer = sender.move()
    sender.trajectory(newer)
    sender.modes(newer)
    assert sender.until_told(newer)[0] == "applied"
    sender.modes(older)
    sender.trajectory(older)
    assert sender.until_told(older)[0] in ("dropped", "refused")
    observer.serve(0.7)
    assert observer.in_force_ns == newer.stamp_ns
