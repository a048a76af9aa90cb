"""Stops at random moments: the measured arm is at rest within the time that the answer states."""

from __future__ import annotations

import multiprocessing
import random
import re
import signal
from contextlib import contextmanager

import numpy as np
import pytest
from tests.support.messages import encode_schedule, encode_trajectory

from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import load_machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, MotionState, Trajectory, quintic_hermite
from mhsb_model.verdict import Outcome, Verdict
from mhsb_msgs_py import reference, topics
from mhsb_msgs_py.reference import Reference

GOALS = ((0.55, 0.60), (0.55, -0.60), (0.85, 0.20), (0.60, 0.45), (0.75, -0.30))
DRIFT = 2e-3
"""Most that a joint of a resting arm moves within half a second, vibrating or settling [rad].

The simulated velocity alternates from step to step by up to 0.06 rad/s, so positions are compared.
"""

LAG = 5.0
"""By which the clock of a second publisher of references is behind [s]."""

SLOW = ("--ros-args", "-p", "v_max:=0.004")
"""So slow that the arm still moves when the next planner is ready."""

MOST_SILENT = 5
"""Of 200 stops, those in which the arm's own ~/stop may go unanswered."""


class Stops:
    """A simulator and a planner, situations in which a test asks for a stop, and their outcome."""

    def __init__(self, observer, start_planner, start_simulator, source):
        self.observer, self.start_planner, self.source = observer, start_planner, source
        start_simulator()
        self.planner = start_planner()
        observer.until(lambda: observer.is_matched and len(observer.references) > 2)
        self.timers = []

    def at_rest(self):
        """Nothing has been asked for."""

    def in_motion(self):
        verdict = self.goal()
        self.observer.until_in_force(verdict)
        self.observer.serve(self.source.uniform(0.0, 1.5))

    def while_planning(self):
        self.observer.send(*self.source.choice(GOALS))
        self.observer.serve(self.source.uniform(0.0, 0.08))

    def while_replanning(self):
        self.in_motion()
        self.while_planning()

    def after_a_restart(self):
        """The planner is killed while its plan is executed, and started anew."""
        self.restart(*SLOW)
        verdict = self.goal()
        self.observer.until_in_force(verdict)
        self.observer.serve(self.source.uniform(0.2, 1.0))
        self.restart()

    def foreign_plan(self):
        """A trajectory of nobody's planner."""
        topics_of_a_plan = topics.JOINT_TRAJECTORY, topics.MODE_COMMANDS
        publishers = [
            self.observer.create_publisher(topic.message, topic.name, topic.qos)
            for topic in topics_of_a_plan
        ]
        self.observer.until(lambda: all(each.get_subscription_count() for each in publishers))
        for direction in (1.0, -1.0):  # one of both is within the workspace
            heard, told = len(self.observer.references), len(self.observer.hand_overs)
            self.observer.until(lambda heard=heard: self.later_than_all_plans(heard))
            halves = self.move(direction * np.array([0.2, 0.15, -0.15]))
            for publisher, message in zip(publishers, halves, strict=True):
                publisher.publish(message)
            self.observer.until(lambda told=told: len(self.observer.hand_overs) > told)
            if self.observer.hand_overs[-1].outcome == "applied":
                break
        assert self.observer.hand_overs[-1].outcome == "applied", self.observer.hand_overs[-1]
        self.observer.serve(self.source.uniform(0.5, 3.0))

    def later_than_all_plans(self, heard):
        """Whether a reference has come, after those heard, that no plan's stamp is later than."""
        stamps = [each.plan_stamp_ns for each in self.observer.hand_overs]
        latest_ns = self.observer.references[-1].stamp_ns
        return len(self.observer.references) > heard and latest_ns > max(stamps, default=0)

    def move(self, by):
        """Both halves of a plan that turns the joints by angles [rad] in 5.2 s, after 0.8 s."""
        latest, machine = self.observer.references[-1], self.observer.machine
        time = np.arange(0.0, 6.01, 0.02)
        begin = latest.state.position
        rests = MotionState.at_rest(begin), MotionState.at_rest(begin + by)
        ends = [(each.position, each.velocity, each.acceleration) for each in rests]
        moving = quintic_hermite(np.clip(time - 0.8, 0.0, 5.2)[:, None], np.array([[5.2]]), *ends)
        offsets = np.round(time * SECOND_NS).astype(np.int64)
        path = Trajectory(latest.stamp_ns, offsets, *moving)
        schedule = ModeSchedule(latest.stamp_ns, np.array([0]), np.array([[1, 1, 1]], np.uint8))
        return (
            encode_trajectory(path, machine.joint_names),
            encode_schedule(schedule, machine.actuator_names),
        )

    def two_planners(self):
        """A second planner has been started beside the first by mistake."""
        self.second = self.start_planner()
        self.observer.send(*self.source.choice(GOALS))
        self.observer.serve(self.source.uniform(0.0, 2.0))

    def lagging_reference(self):
        """Somebody else publishes a reference, by a clock that is behind."""
        self.in_motion()
        topic, machine = topics.REFERENCE, self.observer.machine
        publisher = self.observer.create_publisher(topic.message, topic.name, topic.qos)
        posture = self.observer.references[-1].state.position

        def publish():
            stamp_ns = self.observer.get_clock().now().nanoseconds - round(LAG * SECOND_NS)
            lagging = Reference(stamp_ns, MotionState.at_rest(posture))
            publisher.publish(reference.encode(lagging, machine.joint_names))

        self.timers.append((self.observer.create_timer(0.01, publish), publisher))
        self.observer.serve(self.source.uniform(0.3, 1.0))

    def check(self, situation):
        """Stop in a situation, and compare the answer with the measured arm.

        Returns:
            Whether the stop succeeded; an error must say that the arm's ~/stop was not answered.
        """
        getattr(self, situation)()
        answer = self.observer.call("mhsb_planner/stop")
        # A stop at rest is answered before the next measurement comes.
        self.observer.until(lambda: bool(self.observer.measured))
        answered_ns = self.observer.measured[-1].stamp_ns
        if not answer.success:
            assert "not answered" in answer.message, (situation, answer.message)
        stated = re.search(r"stands still in ([\d.]+) s", answer.message)
        rest_ns = answered_ns + round(float(stated[1]) * SECOND_NS) if stated else answered_ns
        if not answer.success:
            rest_ns += 5 * SECOND_NS
        self.observer.until(lambda: self.observer.measured[-1].stamp_ns > rest_ns + SECOND_NS // 2)
        after = [each for each in self.observer.measured if each.stamp_ns >= rest_ns]
        drift = float(np.ptp([each.position for each in after], axis=0).max())
        assert drift < DRIFT, (situation, answer.message, drift)
        self.clean_up()
        return answer.success

    def clean_up(self):
        """End what a situation has added, and have the next goal work."""
        for timer, publisher in self.timers:
            self.observer.destroy_timer(timer)
            self.observer.destroy_publisher(publisher)
        if self.timers:
            self.timers.clear()
            self.observer.serve(4.0)
        if second := self.__dict__.pop("second", None):
            assert second.stop(signal.SIGINT) == 0
        self.observer.measured.clear()

    def goal(self):
        """Ask for a random goal until one is accepted; its verdict."""
        while True:
            verdict = self.observer.request_verdict(*self.source.choice(GOALS))
            assert verdict.code in (Verdict.OK, Verdict.AT_GOAL), verdict.sentence
            if verdict.code is Verdict.OK:
                return verdict

    def restart(self, *arguments):
        before = self.observer.listeners_to_goals()
        self.planner.stop(signal.SIGKILL)
        self.planner = self.start_planner(*arguments)
        self.observer.until(lambda: bool(self.observer.listeners_to_goals() - before))
        self.observer.until(self.observer.hears_all_planners)


SITUATIONS = (
    "at_rest", "in_motion", "while_planning", "while_replanning", "after_a_restart",
    "foreign_plan", "two_planners", "lagging_reference",
)  # fmt: skip


@pytest.fixture
def stops(observer, start_planner, start_simulator, fresh_seed):
    return Stops(observer, start_planner, start_simulator, random.Random(fresh_seed))


def burn():
    while True:
        pass


@contextmanager
def busy(count):
    """Have busy loops run beside."""
    loops = [multiprocessing.get_context("spawn").Process(target=burn) for _ in range(count)]
    for loop in loops:
        loop.start()
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.join()


def test_a_stop_in_every_situation_brings_the_measured_arm_to_rest(stops, observer):
    for situation in stops.source.sample(SITUATIONS, len(SITUATIONS)):
        assert stops.check(situation), situation
    assert observer.ending_of(stops.goal()).outcome is Outcome.REACHED


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("loops", [0, 2])
def test_a_hundred_stops_at_random_moments_bring_the_measured_arm_to_rest(stops, observer, loops):
    with busy(loops):
        succeeded = [stops.check(SITUATIONS[k % len(SITUATIONS)]) for k in range(100)]
    print(f"{loops} busy loops: {sum(succeeded)} of 100 succeeded")
    assert sum(succeeded) >= 100 - MOST_SILENT // 2
    assert observer.ending_of(stops.goal()).outcome is Outcome.REACHED


def test_fifty_stops_of_an_arm_at_rest_succeed(arm):
    for _ in range(50):
        assert arm.call("mhsb_planner/stop").message == "the arm stands still"


FAULTS = (
    "main_pump", "sensor_dead:actuator_2.length", "sensor_frozen:actuator_2.length",
    "valve_hard_over:actuator_2",
)  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_in_motion_aborts_the_execution_with_the_arms_sentence(arm, fault):
    verdict = arm.request_verdict(0.55, 0.60)
    arm.until_in_force(verdict)
    arm.serve(1.0)
    taken, reason = arm.set_parameter("mhsb_sim", "fault", fault)
    assert taken, reason
    ending = arm.ending_of(verdict)
    assert (ending.outcome, ending.reason) == (Outcome.ABORTED, Verdict.FAULT), ending
    arm.until(lambda: arm.simulator_reports[-1].sentence == ending.sentence)
    assert arm.set_parameter("mhsb_sim", "fault", "none")[0]
    assert arm.call("mhsb_sim/clear_faults").success


@pytest.mark.slow
def test_an_excavator_that_is_stopped_by_its_own_service_ends_its_execution_stopped(
    observer, start_simulator, start_planner
):
    file = find_config_file("excavator.yaml")
    start_simulator("--ros-args", "-p", f"machine:={file}")
    start_planner("--ros-args", "-p", f"machine:={file}")
    observer.machine = load_machine(file)
    observer.until(lambda: observer.is_matched and len(observer.references) > 2)
    for k in range(6):
        verdict = observer.request_verdict(2.4, -1.2 if k % 2 else 1.2, 0.4)
        observer.until_in_force(verdict)
        observer.serve(0.5 + 0.2 * k)
        assert observer.call("mhsb_sim/stop").success
        ending = observer.ending_of(verdict)
        assert (ending.outcome, ending.sentence) == (Outcome.STOPPED, "the arm was asked to stop")
        observer.until(lambda: not observer.references[-1].state.velocity.any())


def test_goals_beside_a_second_simulator_get_one_verdict_each_that_names_it(
    observer, start_planner, start_simulator
):
    start_simulator()
    planner = start_planner()
    observer.until(lambda: observer.is_matched and len(observer.references) > 2)
    start_simulator("--ros-args", "-p", "publish_clock:=true")
    planner.wait_for("2 publishers whose clocks differ")
    for goal in GOALS[:3]:
        verdict = observer.request_verdict(*goal)
        assert verdict.code is Verdict.NO_STATE
        assert "2 publishers" in verdict.sentence
    assert observer.call("mhsb_planner/stop").success
    assert planner.output.count("clock went back") <= 1
