"""The action move_tip over real DDS: goals, cancels, preemption and plans that nobody executes."""

from __future__ import annotations

import random

import numpy as np
import pytest
from action_msgs.msg import GoalStatus

from mhsb_model.goal import Goal
from mhsb_model.verdict import Outcome, Verdict
from mhsb_msgs_py import goal_pose, mode_schedule, qos, trajectory

rclpy_action = pytest.importorskip("rclpy.action")
mhsb_interfaces = pytest.importorskip(
    "mhsb_interfaces.action",
    reason="mhsb_interfaces was not built: no compiler was found (scripts/setup says so)",
)
MoveTip = mhsb_interfaces.MoveTip

UP, DOWN, OUT = (0.55, 0.60), (0.55, -0.60), (0.75, 0.55)
NEAR = 0.70, 0.0
ENDED = {
    GoalStatus.STATUS_SUCCEEDED,
    GoalStatus.STATUS_CANCELED,
    GoalStatus.STATUS_ABORTED,
}


class Client:
    """Sends goals of the action and keeps what comes back."""

    def __init__(self, arm) -> None:
        self.arm = arm
        self.action = rclpy_action.ActionClient(
            arm,
            MoveTip,
            "mhsb_planner/move_tip",
            goal_service_qos_profile=qos.SERVICE,
            result_service_qos_profile=qos.SERVICE,
            cancel_service_qos_profile=qos.SERVICE,
        )
        arm.until(self.action.server_is_ready)
        self.feedback = []

    def begin_sending(self, x, z, *options, plan_only=False):
        """Send a goal; a future of its handle."""
        request = MoveTip.Goal(
            pose=goal_pose.encode(Goal(0, x, z)), plan_only=plan_only, options=list(options)
        )
        return self.action.send_goal_async(
            request, feedback_callback=lambda message: self.feedback.append(message.feedback)
        )

    def send(self, x, z, *options, plan_only=False):
        sending = self.begin_sending(x, z, *options, plan_only=plan_only)
        self.arm.until(sending.done)
        assert sending.result().accepted
        return sending.result()

    def end_of(self, handle, timeout=40.0):
        """Status and result of a goal that ends."""
        asking = handle.get_result_async()
        self.arm.until(asking.done, timeout)
        return asking.result().status, asking.result().result

    def ask(self, *goal, **options):
        return self.end_of(self.send(*goal, **options))

    def cancel(self, handle):
        """Whether the cancel was taken."""
        cancelling = handle.cancel_goal_async()
        self.arm.until(cancelling.done)
        return bool(cancelling.result().goals_canceling)


@pytest.fixture
def client(arm):
    made = Client(arm)
    yield made
    made.action.destroy()


def wait_for_motion(arm):
    arm.until(lambda: np.abs(arm.references[-1].state.velocity).max() > 0.05)


def test_a_goal_is_reached_and_its_progress_told(arm, client):
    status, result = client.ask(*UP)
    assert status == GoalStatus.STATUS_SUCCEEDED, result.message
    assert (result.verdict, result.outcome) == (Verdict.OK, Outcome.REACHED), result.message
    moving = [each for each in client.feedback if each.state == "moving"]
    shares = [each.progress for each in moving]
    assert len(shares) > 5
    assert min(np.diff(shares)) > -0.01  # the arm's time is estimated
    assert shares[-1] > 0.9
    assert all(0 <= mode <= 2 for each in moving for mode in each.modes)
    assert {len(each.modes) for each in moving} == {arm.machine.joint_count}
    # What has been taken step by step adds up to what the plan was to take as a whole.
    assert moving[-1].energy_j == pytest.approx(result.energy_j, rel=0.05)
    assert moving[-1].energy_series_j == pytest.approx(result.energy_series_j, rel=0.05)


def test_the_same_verdict_stands_on_plan_status(arm, client):
    _, result = client.ask(*OUT)
    [verdict] = arm.verdicts.values()
    assert verdict.code == result.verdict == Verdict.OK
    assert verdict.plan.energy_j == result.energy_j


def test_cancel_brings_the_arm_to_rest_before_the_goal(arm, client):
    handle = client.send(*UP)
    wait_for_motion(arm)
    assert client.cancel(handle)
    status, result = client.end_of(handle)
    assert status == GoalStatus.STATUS_CANCELED
    assert result.outcome == Outcome.STOPPED
    arm.until(lambda: not arm.references[-1].state.velocity.any())
    tip = arm.machine.tip_position(arm.references[-1].state.position)
    assert np.hypot(*(tip - UP)) > 0.01


def test_a_cancel_during_planning_ends_canceled_and_nothing_is_published_afterwards(arm, client):
    assert arm.set_parameter("mhsb_planner", "planning_budget", 1.0) == (True, "")
    handle = client.send(*UP)  # planned for a second
    assert client.cancel(handle)
    status, result = client.end_of(handle)
    assert status == GoalStatus.STATUS_CANCELED
    assert (result.verdict, result.outcome) == (Verdict.STOPPED, "")
    arm.serve(1.5)
    assert arm.in_force_ns == 0
    assert not arm.hand_overs
    assert not arm.references[-1].state.velocity.any()


def test_a_newer_goal_preempts_wherever_it_comes_from(arm, client):
    first = client.send(*UP)
    wait_for_motion(arm)
    second = client.send(*DOWN)
    status, result = client.end_of(first)
    assert (status, result.outcome) == (GoalStatus.STATUS_ABORTED, Outcome.REPLACED)
    verdict = arm.request_verdict(*OUT)
    status, result = client.end_of(second)
    assert (status, result.outcome) == (GoalStatus.STATUS_ABORTED, Outcome.REPLACED)
    assert arm.ending_of(verdict).outcome is Outcome.REACHED


def test_cancelling_a_goal_that_a_newer_one_takes_over_from_does_not_stop_the_newer_one(
    arm, client
):
    first = client.send(*UP)
    wait_for_motion(arm)
    second = client.send(*OUT)
    client.cancel(first)
    assert client.end_of(second)[1].outcome == Outcome.REACHED
    status, result = client.end_of(first)
    assert result.outcome == Outcome.REPLACED
    assert status in (GoalStatus.STATUS_CANCELED, GoalStatus.STATUS_ABORTED)


def test_a_plan_alone_is_told_with_its_figures_and_moves_nothing(arm, client):
    option = "planner:=fixed"  # which gives the same plan again, however busy the machine is
    status, planned = client.ask(*NEAR, option, plan_only=True)
    assert (status, planned.verdict) == (GoalStatus.STATUS_SUCCEEDED, Verdict.OK)
    motion = trajectory.decode(planned.joint_trajectory, arm.machine.joint_names)
    schedule = mode_schedule.decode(planned.mode_commands, arm.machine.actuator_names)
    assert np.allclose(arm.machine.tip_position(motion.position[-1]), NEAR, atol=1e-3)
    assert schedule.stamp_ns == motion.stamp_ns
    arm.serve(0.5)
    assert arm.in_force_ns == 0
    assert not arm.verdicts
    _, executed = client.ask(*NEAR, option)
    assert executed.energy_j == pytest.approx(planned.energy_j, rel=0.02)


def test_options_hold_for_one_goal_alone(arm, client):
    _, slow = client.ask(*UP, "v_max:=0.006", "weights:=[1, 1, 0]", plan_only=True)
    _, usual = client.ask(*UP, "weights:=[1, 1, 0]", plan_only=True)
    assert slow.verdict == usual.verdict == Verdict.OK, (slow.message, usual.message)
    assert slow.duration_s > 1.5 * usual.duration_s


STRANGE_OPTIONS = {
    "payload:='": "cannot be read",
    "payload:={a: 1}": "must be a double",
    "payload:={a: {b: {c: 1}}}": "nested more than 1 deep",
    "payload:=2001-13-45": "cannot be read",
    "payload:=2001-12-24": "must be a double",
    "payload:=!!python/name:os.system x": "cannot be read",
    "payload:=0x" + 4000 * "f": "a number has 4002 characters",
    "payload:=0x" + 20_000 * "f": "at most 4096 characters",
    "payload:=" + 60 * "9": "must be from 0 to",
    "payload:=-.inf": "must be from 0 to",
    "payload:=.nan": "payload is nan",
    "payload:=true": "must be a double",
    "payload:=~": "must be a double",
    "weights:=" + 3000 * "[": "nested more than 1 deep",
    "weights:=" + 2000 * "- ": "nested more than 1 deep",
    "weights:=&a [*a]": "must be a double array",
    "weights:=[[1, 2], 0]": "nested more than 1 deep",
    "weights:=[1, a, 2]": "must be a double array",
    "weights:=[]": "must be three finite numbers",
    "goal_via:=[.nan, 1]": "finite numbers",
    "planner:=[table]": "must be a string",
    "planner:=\u2028\x85\ud7ff": "cannot be",
}
"""Options that YAML or ROS cannot read, and what is told of them."""


@pytest.mark.parametrize(
    ("goal", "options", "code", "told"),
    [
        ((3.0, 0.0), (), Verdict.OUT_OF_WORKSPACE, "workspace"),
        (UP, ("planner",), Verdict.OPTIONS, "NAME:=VALUE"),
        (UP, ("lead_min:=0.5",), Verdict.OPTIONS, "is not one of: planner, weights"),
        (UP, ("payload:=-3",), Verdict.OPTIONS, "must be from 0 to"),
        (UP, ("planner:=nobody",), Verdict.OPTIONS, "give one of: "),
        (UP, ("weights:=much",), Verdict.OPTIONS, "must be a double array"),
        ((float("nan"), 0.1), (), Verdict.NOT_FINITE, "finite"),
        (UP, ("planner:=table",) * 101, Verdict.OPTIONS, "must be at most 100"),
    ],
)
@pytest.mark.parametrize("plan_only", [False, True])
def test_a_goal_that_cannot_be_taken_is_aborted_with_its_reason(
    client, goal, options, code, told, plan_only
):
    status, result = client.ask(*goal, *options, plan_only=plan_only)
    assert (status, result.verdict) == (GoalStatus.STATUS_ABORTED, code)
    assert told in result.message


def test_strange_options_are_refused_with_a_sentence_and_the_next_goal_is_executed(arm, client):
    for option, told in STRANGE_OPTIONS.items():
        status, result = client.ask(*UP, option)
        assert (status, result.verdict) == (GoalStatus.STATUS_ABORTED, Verdict.OPTIONS), option
        assert told in result.message
        assert len(result.message) < 500
    result = client.ask(*UP, "payload:=9.5")[1]
    assert result.outcome == Outcome.REACHED, result.message


def goals_and_cancels(arm, client, count) -> list[int]:
    """Send goals at random times, cancel some, wait for the end of each; their statuses."""
    rng, handles = random.Random(3), []
    for _ in range(count):
        handle = client.send(rng.uniform(0.45, 0.75), rng.uniform(-0.5, 0.6))
        handles.append(handle)
        arm.serve(rng.choice([0.0, 0.02, 0.1, 0.5]))
        if rng.random() < 0.5:
            client.cancel(handle)
    ended = [client.end_of(handle) for handle in handles]
    for status, result in ended:
        assert status in ENDED
        assert result.verdict, "a goal without a verdict"
        assert result.outcome or result.verdict != Verdict.OK
    return [status for status, _ in ended]


def test_of_goals_and_cancels_none_is_lost(arm, client):
    statuses = goals_and_cancels(arm, client, 20)
    assert GoalStatus.STATUS_CANCELED in statuses
    assert arm.largest_reference_step() < 1e-3
    assert client.ask(0.6, 0.1)[1].outcome in (Outcome.REACHED, "")


@pytest.mark.slow
def test_of_a_hundred_goals_and_cancels_none_is_lost(arm, client):
    statuses = goals_and_cancels(arm, client, 100)
    assert GoalStatus.STATUS_CANCELED in statuses
    assert arm.largest_reference_step() < 1e-3
    assert client.ask(0.6, 0.1)[1].outcome in (Outcome.REACHED, "")


def goals_at_once(arm, client, count, cancelled, **options):
    """Send goals at once, each result asked for when its goal is accepted, and cancel the first of
    them at once; the results."""
    heights = np.linspace(-0.4, 0.5, count)
    sending = [client.begin_sending(0.6, z, **options) for z in heights.tolist()]
    asking = []
    for each in sending:  # results are kept for a minute: whoever asks after all goals is late
        each.add_done_callback(lambda sent: asking.append(sent.result().get_result_async()))
    arm.until(lambda: len(asking) == count, 60.0)
    handles = [each.result() for each in sending]
    assert all(handle.accepted for handle in handles)
    cancels = [handle.cancel_goal_async() for handle in handles[:cancelled]]
    arm.until(lambda: all(each.done() for each in cancels), 60.0)
    arm.until(lambda: all(each.done() for each in asking), 120.0)
    ended = [each.result() for each in asking]
    assert {each.status for each in ended} <= ENDED
    assert all(each.result.verdict and each.result.message for each in ended)
    return [each.result for each in ended]


def test_of_sixty_goals_at_once_and_thirty_cancels_at_once_each_is_answered(arm, client):
    results = goals_at_once(arm, client, 60, 30)
    assert results[-1].outcome == Outcome.REACHED, results[-1].message
    result = client.ask(*OUT)[1]
    assert result.outcome == Outcome.REACHED, result.message


def test_plans_that_nobody_executes_wait_without_keeping_a_goal_waiting(arm, client):
    waiting = [client.begin_sending(0.6, 0.3, plan_only=True) for _ in range(60)]
    arm.until(lambda: all(each.done() for each in waiting))
    handles = [each.result() for each in waiting]
    results = [handle.get_result_async() for handle in handles]
    result = client.ask(*OUT)[1]
    assert result.outcome == Outcome.REACHED, result.message
    cancels = [handle.cancel_goal_async() for handle in handles]
    arm.until(lambda: all(each.done() for each in (*cancels, *results)))
    assert {each.result().status for each in results} <= ENDED


@pytest.mark.slow
def test_of_a_thousand_goals_at_once_and_five_hundred_cancels_at_once_each_is_answered(arm, client):
    results = goals_at_once(arm, client, 1000, 500)
    assert results[-1].outcome == Outcome.REACHED, results[-1].message
    result = client.ask(*OUT)[1]
    assert result.outcome == Outcome.REACHED, result.message


@pytest.mark.slow
def test_goals_beyond_those_that_may_wait_are_refused_with_a_sentence(arm, client):
    results = goals_at_once(arm, client, 2500, 2500, plan_only=True)
    refused = [each for each in results if "the most that are taken" in each.message]
    assert {each.verdict for each in refused} == {Verdict.DEADLINE}, "some came beyond the bound"
    result = client.ask(*OUT)[1]
    assert result.outcome == Outcome.REACHED, result.message
