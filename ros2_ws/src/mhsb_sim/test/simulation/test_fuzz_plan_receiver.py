"""Whatever halves come, in whatever order: one report for each stamp, and never a jump."""

from __future__ import annotations

import random
from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support import spoiling
from tests.support.messages import encode_schedule, encode_trajectory

from mhsb_model.arm_reports import HandOverOutcome
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, Trajectory, standstill
from mhsb_msgs_py import mode_schedule, names, trajectory
from mhsb_msgs_py.errors import MessageError
from mhsb_sim.simulation.plan_receiver import PlanReceiver

JOINTS, ACTUATORS = names.joint_names(3), names.actuator_names(3)
SEEDS = st.integers(0, 2**64 - 1)
HALVES = 40
NOW_NS = 1_000 * SECOND_NS


class PaperArm:
    """Follows its plan's curve; keeps the largest jump that it was given."""

    def __init__(self, position):
        self.plan_time_ns = NOW_NS
        self.curve = standstill(np.array(position), NOW_NS)
        self.jump = 0.0

    @property
    def planned(self):
        return self.curve.sample(self.plan_time_ns)

    def reference_at(self, time_ns):
        return self.curve.sample(time_ns) if time_ns >= self.curve.stamp_ns else None

    def set_plan(self, path, schedule):
        step = path.sample(self.plan_time_ns).position - self.planned.position
        self.jump = max(self.jump, float(np.abs(step).max()))
        self.curve = path


def halves_of_a_plan(arm, source):
    """Both halves of a good plan that holds the present reference, from about now."""
    stamp_ns = arm.plan_time_ns + source.randrange(-50, 50) * 1_000_000
    position = np.tile(arm.planned.position, (21, 1))
    path = Trajectory(stamp_ns, np.arange(21) * 20_000_000, position, 0 * position, 0 * position)
    schedule = ModeSchedule(stamp_ns, [0], [[0, 0, source.randrange(2)]])
    return encode_trajectory(path, JOINTS), encode_schedule(schedule, ACTUATORS)


def receive(receiver, kind, message, wall):
    """What the node does with a message; the stamp and what is reported."""
    stamp_ns = message.header.stamp.sec * SECOND_NS + message.header.stamp.nanosec
    try:
        if kind == 0:
            return stamp_ns, receiver.add_trajectory(trajectory.decode(message, JOINTS), wall)
        return stamp_ns, receiver.add_schedule(mode_schedule.decode(message, ACTUATORS), wall)
    except MessageError as error:
        return stamp_ns, receiver.add_unusable(stamp_ns, str(error), wall)


def ordeal(machine, seed):
    """Halves of plans, spoilt and not, lost, doubled and out of order, while time goes on.

    How often each stamp was told of, the stamps that were sent, and the largest jump.
    """
    source = random.Random(seed)
    arm = PaperArm(machine.config.simulation.start_posture)
    receiver = PlanReceiver(machine, arm)
    wall, told, given, kept = 0.0, Counter(), set(), []
    for _ in range(HALVES):
        kept += list(enumerate(halves_of_a_plan(arm, source)))
        kind, message = kept[source.randrange(max(0, len(kept) - 6), len(kept))]
        if source.random() < 0.3:
            message = spoiling.damage_message(message, source, source.randint(1, 3))
        stamp_ns, reports = receive(receiver, kind, message, wall)
        given.add(stamp_ns)
        wall += source.choice((0.0, 0.001, 0.02, 0.6))
        arm.plan_time_ns += source.choice((0, 1_000_000, 30_000_000))
        reports += receiver.update(wall)
        if source.random() < 0.05:
            reports += receiver.invalidate_plans("the arm was stopped")
        told.update(report.plan_stamp_ns for report in reports)
        assert all(len(report.sentence) > 10 for report in reports)
        applied = [each for each in reports if each.outcome is HandOverOutcome.APPLIED]
        assert all(max(each.position_jump, each.velocity_jump) <= 1e-6 for each in applied)
    arm.plan_time_ns += SECOND_NS
    told.update(report.plan_stamp_ns for report in receiver.update(wall + 1.0))
    return told, given, arm.jump


@settings(max_examples=100, derandomize=False)
@given(seed=SEEDS)
def test_each_stamp_is_reported_once_and_nothing_jumps(machine, seed):
    told, given, jump = ordeal(machine, seed)
    assert told == dict.fromkeys(given, 1)
    assert jump <= 1e-6


@pytest.mark.slow
@pytest.mark.timeout(1200)
@settings(max_examples=2500, derandomize=False)
@given(seed=SEEDS)
def test_a_hundred_thousand_halves_are_reported_and_never_jump(machine, seed):
    told, given, jump = ordeal(machine, seed)
    assert told == dict.fromkeys(given, 1)
    assert jump <= 1e-6
