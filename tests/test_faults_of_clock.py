"""Simulated time that stops, goes back or jumps ahead, under a planner that goes by it.

The test is the arm here, and the clock: an arm without mechanics, whose reference is its plan's
curve, and which takes plans as the contract says.
"""

from __future__ import annotations

import time

import numpy as np
import pytest
from rosgraph_msgs.msg import Clock

from mhsb_model.arm_reports import HandOverOutcome, HandOverReason, HandOverReport
from mhsb_model.trajectory import SECOND_NS, standstill
from mhsb_model.verdict import Outcome, Verdict
from mhsb_msgs_py import (
    joint_state,
    mode_schedule,
    modes_in_force,
    reference,
    sim_status,
    stamps,
    topics,
    trajectory,
)
from mhsb_msgs_py.joint_state import JointSample
from mhsb_msgs_py.reference import Reference

UP, DOWN = (0.55, 0.60), (0.55, -0.60)
PERIOD = 0.01  # s
BEGIN_NS = 100 * SECOND_NS
JUMP = 1e-6  # rad, rad/s


class PaperArm:
    """Publishes the clock, and follows plans by it."""

    def __init__(self, observer):
        self.node, self.machine = observer, observer.machine
        self.now_ns, self.running, self.in_force_ns = BEGIN_NS, True, 0
        start = np.array(self.machine.config.simulation.start_posture)
        self.curve = standstill(start, self.now_ns)
        self.halves = {}
        self.applied, self.refused = [], []
        self.publishers = {
            topic: observer.create_publisher(topic.message, topic.name, topic.qos)
            for topic in (
                topics.CLOCK,
                topics.REFERENCE,
                topics.JOINT_STATES,
                topics.MODES,
                topics.PLAN_IN_FORCE,
                topics.DIAGNOSTICS,
            )
        }
        for topic, callback in (
            (topics.JOINT_TRAJECTORY, self.on_trajectory),
            (topics.MODE_COMMANDS, self.on_modes),
        ):
            observer.create_subscription(topic.message, topic.name, callback, topic.qos)
        self.tell_in_force(0)
        self.ticked = time.monotonic()
        observer.create_timer(PERIOD, self.tick)

    # --- Time ------------------------------------------------------------------------------------

    def tick(self):
        """As much later as real time is, if the clock runs."""
        now = time.monotonic()
        if self.running:
            self.now_ns += round((now - self.ticked) * SECOND_NS)
        self.ticked = now
        self.take_over()
        if self.in_force_ns and self.now_ns > self.curve.end_ns:
            self.tell_in_force(0)
        self.publish(topics.CLOCK, Clock(clock=stamps.to_time(self.now_ns)))
        names, state = self.machine.joint_names, self.state
        self.publish(topics.REFERENCE, reference.encode(Reference(self.now_ns, state), names))
        sample = JointSample(self.now_ns, state.position, state.velocity)
        self.publish(topics.JOINT_STATES, joint_state.encode(sample, names))
        self.publish(topics.MODES, modes_in_force.encode(np.zeros(3, np.uint8)))

    def set_back(self, seconds):
        """The clock starts anew, and so does the arm, where it is."""
        held = self.state.position
        self.now_ns -= round(seconds * SECOND_NS)
        self.curve, self.halves = standstill(held, self.now_ns), {}
        self.tell_in_force(0)

    @property
    def state(self):
        return self.curve.sample(self.now_ns)

    # --- Plans -----------------------------------------------------------------------------------

    def on_trajectory(self, message):
        self.halves["path"] = trajectory.decode(message, self.machine.joint_names)
        self.take_over()

    def on_modes(self, message):
        self.halves["modes"] = mode_schedule.decode(message, self.machine.actuator_names)
        self.take_over()

    def take_over(self):
        """Follow a complete plan whose time has come, if it continues the reference."""
        path, modes = self.halves.get("path"), self.halves.get("modes")
        if path is None or modes is None or path.stamp_ns != modes.stamp_ns:
            return
        if path.stamp_ns > self.now_ns:
            return
        self.halves = {}
        old, new = self.state, path.sample(self.now_ns)
        jump = float(np.abs(new.position - old.position).max())
        faster = float(np.abs(new.velocity - old.velocity).max())
        taken = max(jump, faster) <= JUMP
        (self.applied if taken else self.refused).append(path.stamp_ns)
        outcome = HandOverOutcome.APPLIED if taken else HandOverOutcome.REFUSED
        reason = HandOverReason.NONE if taken else HandOverReason.LATE
        report = HandOverReport(outcome, "by the test", path.stamp_ns, jump, faster, reason)
        self.publish(topics.DIAGNOSTICS, sim_status.encode(report, self.now_ns))
        if taken:
            self.curve = path
            self.tell_in_force(path.stamp_ns)

    def tell_in_force(self, stamp_ns):
        self.in_force_ns = stamp_ns
        self.publish(topics.PLAN_IN_FORCE, stamps.to_time(stamp_ns))

    def publish(self, topic, message):
        self.publishers[topic].publish(message)


@pytest.fixture
def paper_arm(observer, start_planner):
    arm = PaperArm(observer)
    planner = start_planner("--ros-args", "-p", "use_sim_time:=true")
    observer.until(lambda: observer.is_matched)
    observer.until(lambda: observer.references)
    yield arm
    assert planner.stop() == 0, planner.output
    assert "Traceback" not in planner.output


def accepted(observer, goal):
    verdict = observer.request_verdict(*goal)
    assert verdict.code is Verdict.OK, verdict.sentence
    return verdict


def until_moving(observer, arm):
    """Until the arm moves, and the planner has had time to hear of it."""
    observer.until(lambda: arm.in_force_ns and arm.state.velocity.any())
    observer.serve(0.5)


def tip(arm):
    return arm.machine.tip_position(arm.state.position)


def test_time_of_the_tests_arm_is_the_planners_and_goals_are_reached(observer, paper_arm):
    verdict = accepted(observer, UP)
    assert BEGIN_NS < verdict.plan.plan_stamp_ns < BEGIN_NS + 600 * SECOND_NS
    until_moving(observer, paper_arm)
    later = accepted(observer, DOWN)
    assert observer.ending_of(verdict).outcome is Outcome.REPLACED
    assert observer.ending_of(later).outcome is Outcome.REACHED
    assert np.hypot(*(tip(paper_arm) - DOWN)) < 1e-4


def test_a_clock_that_stops_for_a_while_stops_the_motion_and_nothing_else(observer, paper_arm):
    verdict = accepted(observer, UP)
    until_moving(observer, paper_arm)
    paper_arm.running = False
    observer.serve(1.5)
    in_force_ns = paper_arm.in_force_ns
    assert in_force_ns != 0
    assert verdict.goal_stamp_ns not in observer.executions
    paper_arm.running = True
    assert observer.ending_of(verdict).outcome is Outcome.REACHED
    assert len(paper_arm.applied) == 1


def test_a_goal_that_comes_while_the_clock_stands_is_answered_and_reached_when_it_goes_on(
    observer, paper_arm
):
    first = accepted(observer, UP)
    until_moving(observer, paper_arm)
    paper_arm.running = False
    observer.serve(0.5)
    stamp_ns = observer.send(*DOWN)
    observer.serve(1.0)
    paper_arm.running = True
    observer.until(lambda: stamp_ns in observer.verdicts)
    verdict = observer.verdicts[stamp_ns]
    assert verdict.code is Verdict.OK, verdict.sentence
    assert observer.ending_of(verdict).outcome is Outcome.REACHED
    assert observer.ending_of(first).outcome is Outcome.REPLACED


def test_a_clock_that_goes_back_ends_what_was_executed_and_the_next_goal_is_planned_from_there(
    observer, paper_arm
):
    first = accepted(observer, UP)
    until_moving(observer, paper_arm)
    paper_arm.set_back(50.0)
    ending = observer.ending_of(first)
    assert ending.outcome in (Outcome.ABORTED, Outcome.STOPPED), ending.sentence
    now_ns = paper_arm.now_ns
    verdict = accepted(observer, DOWN)
    assert abs(verdict.plan.plan_stamp_ns - now_ns) < 20 * SECOND_NS
    assert observer.ending_of(verdict).outcome is Outcome.REACHED
    assert np.hypot(*(tip(paper_arm) - DOWN)) < 1e-4


def test_a_goal_that_is_being_planned_when_the_clock_goes_back_is_planned_anew(observer, paper_arm):
    accepted(observer, UP)
    until_moving(observer, paper_arm)
    stamp_ns = observer.send(*DOWN)
    paper_arm.set_back(50.0)
    observer.until(lambda: stamp_ns in observer.verdicts)
    verdict = observer.verdicts[stamp_ns]
    assert verdict.code is Verdict.OK, verdict.sentence
    assert observer.ending_of(verdict).outcome is Outcome.REACHED
    assert paper_arm.applied[-1] < BEGIN_NS
    assert np.hypot(*(tip(paper_arm) - DOWN)) < 1e-4


def test_a_clock_that_jumps_ahead_ends_the_motion_and_the_next_goal_goes_on_from_its_end(
    observer, paper_arm
):
    first = accepted(observer, UP)
    until_moving(observer, paper_arm)
    paper_arm.now_ns += 60 * SECOND_NS
    observer.ending_of(first)  # the arm is at its plan's end; what is measured tells it later
    verdict = accepted(observer, DOWN)
    assert observer.ending_of(verdict).outcome is Outcome.REACHED
    assert np.hypot(*(tip(paper_arm) - DOWN)) < 1e-4


def test_without_any_clock_goals_are_answered_all_the_same(observer, start_planner):
    planner = start_planner("--ros-args", "-p", "use_sim_time:=true")
    observer.until(lambda: observer.is_matched)
    verdict = observer.request_verdict(*UP)
    assert verdict.code is Verdict.NO_STATE
    assert planner.stop() == 0
