"""The lifecycle under any order of events: goals, stops, zones, faults, lost and late plans."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule, run_state_machine_as_test

from mhsb_model.obstacles.zones import Zones
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.verdict import Outcome, Verdict
from mhsb_planner.online.settings import Settings

POINTS = [(0.55, 0.60), (0.55, -0.60), (0.75, 0.55), (0.6, 0.1), (0.9, 0.0), (2.0, 0.0), (0.0, 0.3)]
BOX = Zones(boxes=((0.70, 0.20, 0.95, 0.40),))


class Life(RuleBasedStateMachine):
    """Everything that can happen to a planner, with a check of what was promised after each."""

    new_world = None

    def __init__(self) -> None:
        super().__init__()
        self.world = type(self).new_world(lead_max=0.3)
        self.base = self.world.life.state.settings
        self.stops: list[int] = []
        self.asked_to_stop = 0

    @rule(point=st.sampled_from(POINTS))
    def a_goal_comes(self, point):
        self.world.send_goal(*point)
        self.stops.clear()

    @rule(seconds=st.sampled_from([0.005, 0.02, 0.05, 0.2, 1.0, 3.0]))
    def time_passes(self, seconds):
        self.world.pass_time(seconds)

    @rule(seconds=st.sampled_from([0.005, 0.05, 0.2, 0.6]))
    def planning_takes(self, seconds):
        self.world.planning_time = seconds

    @rule(seconds=st.sampled_from([0.001, 0.01, 0.1]))
    def messages_take(self, seconds):
        self.world.transport = seconds

    @rule(report=st.sampled_from([0.0, 0.1, 0.8]), in_force=st.sampled_from([0.0, 0.1, 0.8]))
    def what_the_arm_tells_takes(self, report, in_force):
        self.world.report_delay, self.world.in_force_delay = report, in_force

    @rule(count=st.integers(1, 3))
    def commands_get_lost(self, count):
        self.world.lost = count

    @rule()
    def the_planner_is_asked_to_stop(self):
        self.asked_to_stop += 1
        asked_after = self.world.goals

        def done(success: bool, sentence: str) -> None:
            if success and self.world.goals == asked_after:
                self.stops.append(asked_after)

        self.world.life.stop(done)

    @rule()
    def the_arm_is_stopped_by_somebody(self):
        self.world.arm.stop_at_once()

    @rule(frozen=st.booleans())
    def the_arm_freezes_or_thaws(self, frozen):
        self.world.arm.frozen = frozen

    @rule()
    def the_arm_starts_anew(self):
        self.world.arm.restart(SECOND_NS)
        self.world.life.handle_clock_jump("the clock went back")

    @rule(fault=st.sampled_from(["", "a pump failed"]))
    def a_fault_comes_or_goes(self, fault):
        self.world.arm.fault = fault
        if fault:
            self.world.arm.stop_at_once()

    @rule(zones=st.sampled_from([Zones(), BOX]), payload=st.sampled_from([5.0, 10.0]))
    def settings_change(self, zones, payload):
        machine = self.base.machine.changed(payload=payload, zones=zones)
        self.world.life.change_settings(
            Settings(machine, self.base.options, self.base.lead_min, self.base.lead_max)
        )

    @invariant()
    def no_goal_is_answered_twice(self):
        for stamp in range(1, self.world.goals + 1):
            verdicts, endings = self.world.verdicts(stamp), self.world.execution_reports(stamp)
            assert len(verdicts) <= 1
            assert len(endings) <= sum(each.code is Verdict.OK for each in verdicts)

    @invariant()
    def the_reference_never_jumps(self):
        self.world.check_that_nothing_sent_jumps()

    @invariant()
    def stamps_increase_between_clock_jumps(self):
        stamps = [command.stamp_ns for command in self.world.sent]
        drops = sum(b <= a for a, b in itertools.pairwise(stamps))
        jumps = sum("clock" in warning for warning in self.world.warnings)
        assert drops <= jumps

    def teardown(self):
        """When all is well again every goal gets its end, and a new one is reached."""
        world = self.world
        stopped = bool(self.stops)
        world.lost, world.transport, world.planning_time = 0, 0.002, 0.02
        world.arm.frozen, world.arm.fault = False, ""
        world.report_delay = world.in_force_delay = 0.0
        world.pass_time(1.0)  # what is still on its way
        world.life.change_settings(self.base)
        world.pass_time(0.1)
        if stopped:
            world.pass_time(3.0)
            resting = world.arm.reference.position
            world.pass_time(5.0)
            np.testing.assert_array_equal(world.arm.reference.position, resting)
        world.pass_time_until(lambda: world.is_idle, 60.0)
        world.check_that_each_goal_was_answered_once()
        goal = (0.5, 0.3)
        stamp = world.send_goal(*goal)
        assert world.verdict(stamp).code in (Verdict.OK, Verdict.AT_GOAL)
        world.pass_time_until(lambda: world.tip_is_at(*goal))


@pytest.mark.timeout(600)
@pytest.mark.parametrize("examples", [12, pytest.param(100, marks=pytest.mark.slow)])
def test_whatever_happens_goals_are_answered_once_and_the_next_one_is_reached(new_world, examples):
    Life.new_world = staticmethod(new_world)
    run_state_machine_as_test(
        Life,
        settings=settings(
            max_examples=examples,
            stateful_step_count=25,
            suppress_health_check=list(HealthCheck),
            phases=[Phase.generate],  # a shorter example would take minutes to find
        ),
    )


ORDERS = [(0.0, 0.0), (0.0, 0.1), (0.0, 0.8), (0.1, 0.0), (0.8, 0.0), (0.8, 0.7)]
"""Delays of the arm's report and of `plan_in_force` [s]."""


@pytest.mark.parametrize(("report", "in_force"), ORDERS)
def test_a_fault_in_motion_aborts_with_its_reason_whichever_message_comes_first(
    world, report, in_force
):
    stamp = world.send_goal(0.55, 0.60)
    world.pass_time_until(lambda: world.arm.is_moving)
    world.pass_time(1.0)
    world.report_delay, world.in_force_delay = report, in_force
    world.arm.fault = "the main pump failed"
    world.arm.stop_at_once()
    failed_ns = world.arm.clock_ns
    ending = world.execution_report(stamp)
    assert (ending.outcome, ending.reason) == (Outcome.ABORTED, Verdict.FAULT), ending
    assert "the main pump failed" in ending.sentence
    assert world.arm.clock_ns - failed_ns <= SECOND_NS
    world.pass_time(3.0)
    world.check_that_each_goal_was_answered_once()


@pytest.mark.parametrize(("report", "in_force"), ORDERS)
def test_an_arm_stopped_by_somebody_ends_stopped_whichever_message_comes_first(
    world, report, in_force
):
    stamp = world.send_goal(0.55, 0.60)
    world.pass_time_until(lambda: world.arm.is_moving)
    world.pass_time(1.0)
    world.report_delay, world.in_force_delay = report, in_force
    world.arm.stop_at_once()
    assert world.execution_report(stamp).outcome is Outcome.STOPPED, world.execution_report(
        stamp
    ).sentence
    world.pass_time(3.0)
    world.check_that_each_goal_was_answered_once()
