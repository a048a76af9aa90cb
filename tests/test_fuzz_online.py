"""Strange messages by the thousand at both nodes over real DDS: nothing but verdicts and reports.

What the codecs make of 100,000 more is tested beside them; here it is whole nodes.
"""

from __future__ import annotations

import random
import time
from functools import partial

import numpy as np
import pytest
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.serialization import serialize_message
from tests.support import spoiling
from tests.support.messages import encode_schedule, encode_trajectory

from mhsb_model.goal import Goal
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import Trajectory
from mhsb_model.verdict import GoalVerdict, Outcome, Verdict
from mhsb_msgs_py import goal_pose, plan_status, topics

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]

GOALS, PLANS, BYTES, PARAMETERS = 4000, 3000, 3000, 600
AT_ONCE = 8
"""Messages without a look whether they were taken; more than ten would be dropped on the way."""

PACE = 0.004  # s


@pytest.fixture
def source(fresh_seed):
    return random.Random(fresh_seed)


@pytest.fixture
def verdicts(arm):
    """Every verdict that is given, in order."""
    given = []

    def keep(message):
        given.extend(each for each in plan_status.decode(message) if isinstance(each, GoalVerdict))

    topic = topics.PLAN_STATUS
    arm.create_subscription(topic.message, topic.name, keep, topic.qos)
    arm.serve(0.5)
    return given


def answered(verdicts, count):
    return len(verdicts) >= count


def still_well(arm):
    """The arm can still be sent somewhere, without a jump on the way."""
    arm.references.clear()
    for goal in ((0.6, 0.1), (0.55, 0.2)):
        verdict = arm.request_verdict(*goal)
        assert verdict.code is Verdict.OK, verdict.sentence
        ending = arm.ending_of(verdict)
        assert ending.outcome is Outcome.REACHED, ending.sentence
    assert arm.largest_reference_step() < 1e-3
    tip = arm.machine.tip_position(arm.references[-1].state.position)
    assert np.hypot(*(tip - goal)) < 1e-4


def test_each_of_many_strange_goals_gets_exactly_one_verdict(arm, verdicts, source):
    def send_some():
        for _ in range(AT_ONCE):
            good = Goal(time.time_ns(), source.uniform(0.2, 0.9), source.uniform(-0.7, 0.7))
            message = spoiling.damage_message(goal_pose.encode(good), source, source.randint(1, 3))
            arm.goal_publisher.publish(message)
        return AT_ONCE

    sent = 0
    while sent < GOALS:
        sent += send_some()
        arm.until(partial(answered, verdicts, sent), 30.0)
    arm.serve(1.0)
    assert len(verdicts) == sent
    counted = {code: sum(each.code is code for each in verdicts) for code in Verdict}
    assert counted[Verdict.NOT_FINITE] > GOALS / 40
    assert counted[Verdict.FRAME] > GOALS / 40
    assert all(len(each.sentence) > 10 for each in verdicts)
    still_well(arm)


def test_strange_plans_neither_move_the_arm_out_of_its_limits_nor_end_the_simulator(arm, source):
    halves = {
        topic: arm.create_publisher(topic.message, topic.name, topic.qos)
        for topic in (topics.JOINT_TRAJECTORY, topics.MODE_COMMANDS)
    }
    arm.until(lambda: all(each.get_subscription_count() for each in halves.values()))
    names, actuators = arm.machine.joint_names, arm.machine.actuator_names
    stamps = set()
    for _ in range(PLANS):
        held, schedule = holding_plan(arm.references[-1])
        stamps.add(held.stamp_ns)
        messages = {
            topics.JOINT_TRAJECTORY: encode_trajectory(held, names),
            topics.MODE_COMMANDS: encode_schedule(schedule, actuators),
        }
        victim = source.choice(list(messages))
        messages[victim] = spoiling.damage_message(messages[victim], source, source.randint(1, 3))
        for topic in source.sample(list(messages), source.choice((1, 2, 2, 2))):
            halves[topic].publish(messages[topic])
        arm.serve(PACE)
    arm.serve(1.0)
    positions = np.array([each.state.position for each in arm.references])
    limits = arm.machine.arrays
    assert np.all(positions >= limits.joint_min - 1e-6)
    assert np.all(positions <= limits.joint_max + 1e-6)
    assert len(arm.hand_overs) > len(stamps) / 2  # each stamp is told of once
    assert all(len(each.sentence) > 10 for each in arm.hand_overs)
    assert arm.call("mhsb_sim/reset").success
    arm.until(lambda: arm.in_force_ns == 0)
    still_well(arm)


def holding_plan(latest):
    """A second in which the reference stays where it is."""
    path = np.tile(latest.state.position, (51, 1))
    offset = 20_000_000 * np.arange(51)
    held = Trajectory(latest.stamp_ns, offset, path, 0 * path, 0 * path)
    return held, ModeSchedule(latest.stamp_ns, np.array([0]), np.array([[0, 0, 0]]))


def test_torn_bytes_on_every_topic_leave_both_nodes_alive(arm, verdicts, source):
    latest = arm.references[-1]
    held, schedule = holding_plan(latest)
    messages = {
        topics.GOAL_POSE: goal_pose.encode(Goal(7, 0.5, 0.1)),
        topics.JOINT_TRAJECTORY: encode_trajectory(held, arm.machine.joint_names),
        topics.MODE_COMMANDS: encode_schedule(schedule, arm.machine.actuator_names),
    }
    publishers = {
        topic: arm.create_publisher(topic.message, topic.name, topic.qos) for topic in messages
    }
    arm.until(lambda: all(each.get_subscription_count() for each in publishers.values()))
    whole = {topic: serialize_message(message) for topic, message in messages.items()}
    for _ in range(BYTES):
        topic = source.choice(list(whole))
        publishers[topic].publish(spoiling.damage_bytes(whole[topic], source))
        arm.serve(PACE)
    arm.serve(1.0)
    assert arm.call("mhsb_sim/reset").success
    still_well(arm)


@pytest.mark.parametrize("node", ["mhsb_planner", "mhsb_sim"])
def test_strange_parameters_are_taken_or_refused_with_a_reason(arm, source, node):
    client = arm.create_client(SetParameters, f"{node}/set_parameters")
    arm.until(client.service_is_ready)
    names = PARAMETER_NAMES[node]
    answers = []
    for _ in range(PARAMETERS):
        name = source.choice([*names, source.choice(spoiling.SPOILED_TEXTS)])
        request = SetParameters.Request(parameters=[Parameter(name=name, value=strange(source))])
        future = client.call_async(request)
        arm.until(future.done, 30.0)
        answers += [(name, result) for result in future.result().results]
    refused = [(name, result.reason) for name, result in answers if not result.successful]
    assert len(refused) > PARAMETERS / 3
    assert [name for name, reason in refused if not reason] == []


PARAMETER_NAMES = {
    "mhsb_planner": [
        *("planner", "weights", "energy_reading", "payload", "supply_pressure", "v_max"),
        *("planning_budget", "lead_min", "lead_max", "goal_psi", "area_weight"),
        *("zone_boxes", "zone_circles", "tip_zone_boxes", "tip_zone_circles"),
        *("machine", "table", "use_sim_time"),
    ],
    "mhsb_sim": [
        *("machine", "seed", "controller", "real_time_factor", "publish_clock", "payload"),
        *("fault", "use_sim_time"),
    ],
}


def strange(source):
    """A parameter's value of any type."""
    number = source.choice(spoiling.SPOILED_FLOATS)
    choices = (*spoiling.SPOILED_FLOATS, source.uniform(-1.0, 1.0))
    numbers = source.choices(choices, k=source.randrange(9))
    kind = source.randrange(10)
    return ParameterValue(
        type=kind,
        bool_value=bool(source.randrange(2)),
        integer_value=source.choice((0, 1, -1, 2**31, -(2**63), 2**63 - 1)),
        double_value=number,
        string_value=source.choice(spoiling.SPOILED_TEXTS),
        double_array_value=numbers,
        integer_array_value=[source.randrange(-5, 5) for _ in numbers],
        string_array_value=[source.choice(spoiling.SPOILED_TEXTS) for _ in numbers],
        bool_array_value=[True] * len(numbers),
    )
