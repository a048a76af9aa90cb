"""The simulator supervised over real DDS: what it refuses and why, and what a fault stops."""

from __future__ import annotations

import math
import signal

import numpy as np
import pytest

from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_model.verdict import Outcome, Verdict
from mhsb_msgs_py import mode_schedule, stamps, topics, trajectory

UP = (0.55, 0.60)
SPACING_NS = SECOND_NS // 50
POINTS = 50


class Commander:
    """Publishes halves of plans on behalf of a planner."""

    def __init__(self, observer):
        self.observer = observer
        self.publishers = [
            observer.create_publisher(topic.message, topic.name, topic.qos)
            for topic in (topics.JOINT_TRAJECTORY, topics.MODE_COMMANDS)
        ]
        observer.until(lambda: all(p.get_subscription_count() == 1 for p in self.publishers))
        observer.until(lambda: len(observer.references) > 0)

    def plan(self, shift=0.0, modes=(0, 0, 0)):
        """Messages of a plan that holds the present reference, or one beside it [rad]."""
        self.observer.serve(0.05)  # so that stamps increase
        machine, latest = self.observer.machine, self.observer.references[-1]
        path = np.tile(latest.state.position + shift, (POINTS, 1))
        zero = np.zeros_like(path)
        offsets = SPACING_NS * np.arange(POINTS)
        held = Trajectory(latest.stamp_ns, offsets, path, zero, zero)
        schedule = ModeSchedule(latest.stamp_ns, np.array([0]), np.array([modes]))
        return (
            trajectory.encode(held, machine.joint_names),
            mode_schedule.encode(schedule, machine.actuator_names),
        )

    def outcome_of(self, messages):
        """Send both halves, wait for what the simulator says first of their stamp."""
        stamp_ns = stamps.from_time(messages[0].header.stamp)
        for publisher, message in zip(self.publishers, messages, strict=True):
            publisher.publish(message)
        said = []

        def heard():
            said[:] = [each for each in self.observer.hand_overs if each.plan_stamp_ns == stamp_ns]
            return said

        self.observer.until(heard)
        return said[0]


@pytest.fixture
def simulator(start_simulator):
    child = start_simulator()
    yield child
    if child.process.poll() is None:
        assert child.stop(signal.SIGINT) == 0, child.output
        assert "Traceback" not in child.output


@pytest.fixture
def commander(observer, simulator):
    return Commander(observer)


def test_it_holds_at_the_start_and_takes_a_plan_that_continues(observer, commander):
    first = observer.references[-1].state
    observer.serve(0.5)
    np.testing.assert_array_equal(observer.references[-1].state.position, first.position)
    assert observer.in_force_ns == 0
    assert commander.outcome_of(commander.plan()).outcome == "applied"


def test_what_cannot_be_followed_is_refused_with_its_reason(observer, commander):
    before = observer.references[-1].state.position

    jump = commander.plan(shift=1e-3)
    assert "it is 0.001 rad" in commander.outcome_of(jump).sentence

    beyond_budget = commander.plan(modes=(2, 2, 1))
    said = commander.outcome_of(beyond_budget)
    assert "SB-SB-DB needs 5 booster modules, 4 are fitted" in said.sentence

    not_finite = commander.plan()
    not_finite[0].points[7].positions[1] = math.nan
    said = commander.outcome_of(not_finite)
    assert said.outcome == "refused"
    assert "point 7" in said.sentence

    misnamed = commander.plan()
    misnamed[0].joint_names = ["joint_1", "joint_2", "elbow"]
    said = commander.outcome_of(misnamed)
    assert said.outcome == "refused"
    assert "elbow" in said.sentence

    unknown_mode = commander.plan()
    unknown_mode[1].points[0].positions[2] = 3.0
    said = commander.outcome_of(unknown_mode)
    assert said.outcome == "refused"
    assert "give 0 (N), 1 (DB) or 2 (SB)" in said.sentence

    observer.serve(0.7)  # halves whose other half was refused have been dropped by now
    assert observer.hand_overs[-1].outcome == "dropped"
    assert observer.in_force_ns == 0
    np.testing.assert_array_equal(observer.references[-1].state.position, before)


def test_when_the_planner_is_gone_the_plan_is_finished_and_its_end_held(
    observer, simulator, start_planner
):
    planner = start_planner()
    observer.until(lambda: observer.matched and len(observer.references) > 0)
    verdict = observer.ask(0.50, 0.10)
    assert verdict.code is Verdict.OK, verdict.sentence
    observer.until_in_force(verdict)
    planner.process.kill()
    planner.wait()
    observer.until(lambda: observer.in_force_ns == 0, verdict.plan.duration_s + 5.0)
    observer.serve(0.3)
    end = observer.references[-1].state
    assert not end.velocity.any()
    assert np.hypot(*(observer.machine.tip_position(end.position) - (0.50, 0.10))) < 1e-4


@pytest.mark.parametrize("service", ["clear_faults", "reset"])
def test_nan_is_a_named_fault_that_stops_cleanly_until_it_is_cleared(arm, service):
    verdict = arm.ask(*UP)
    arm.until_in_force(verdict)
    taken, reason = arm.set_parameter("mhsb_sim", "fault", "sensor")
    assert taken, reason
    arm.until(lambda: arm.simulator_reports and arm.simulator_reports[-1].faulty)
    assert "the sensor of a line pressure is no longer finite" in arm.simulator_reports[-1].sentence
    arm.until(lambda: arm.in_force_ns == 0)
    assert arm.ending_of(verdict).outcome in (Outcome.ABORTED, Outcome.STOPPED)
    heard = len(arm.references)
    arm.serve(0.5)
    assert len(arm.references) == heard
    assert all(np.isfinite(each.state.position).all() for each in arm.references)
    assert not arm.call("mhsb_sim/stop").success

    assert arm.call(f"mhsb_sim/{service}").success
    arm.until(lambda: len(arm.references) > heard + 10)
    arm.until(lambda: not arm.simulator_reports[-1].faulty)
    later = arm.ask(*UP)
    assert later.code is Verdict.OK, later.sentence
    arm.until_in_force(later)


def test_an_unknown_fault_is_refused_with_the_valid_ones(arm):
    taken, reason = arm.set_parameter("mhsb_sim", "fault", "gremlins")
    assert not taken
    assert "valid are none, sensor, servo_pumps, main_pump" in reason
