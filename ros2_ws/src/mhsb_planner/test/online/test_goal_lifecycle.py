"""The life of goals, event by event: each is answered once, and nothing unconfirmed counts."""

import gc
import re
import weakref
from dataclasses import replace

import numpy as np
import pytest

from mhsb_model.arm_reports import HandOverReason
from mhsb_model.circuit.dead_time import compute_dead_time
from mhsb_model.goal import Goal
from mhsb_model.obstacles.zones import Zones
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.verdict import Outcome, Verdict
from mhsb_planner.online.arm_state import NO_PLAN
from mhsb_planner.online.arm_stops import ArmStops
from mhsb_planner.online.goal_stream import GoalStream
from mhsb_planner.online.pending_goal import keep_settings
from mhsb_planner.online.rest_detector import REST_TIME
from mhsb_planner.online.settings import Settings
from mhsb_planner.planner import PlanOptions

UP, DOWN, OUT = (0.55, 0.60), (0.55, -0.60), (0.75, 0.55)
STRETCHED = (0.95, 0.30)


def under_way(world, goal=UP, seconds=1.0) -> int:
    stamp = world.send_goal(*goal)
    world.pass_time_until(lambda: world.arm.is_moving)
    world.pass_time(seconds)
    return stamp


def across_the_way(world) -> Settings:
    """Settings with a zone in which the tip would be later on its way, given what is in force."""
    now_ns, way = world.arm.time_ns, world.arm.command.trajectory
    later = way.sample(now_ns + (way.end_ns - now_ns) // 2)
    x, z = world.machine.tip_position(later.position)
    zones = Zones(tip_circles=((float(x), float(z), 0.03),))
    return Settings(world.machine.changed(zones=zones), PlanOptions(planner="integrated"))


def test_a_goal_is_planned_confirmed_and_reached(world):
    stamp = world.send_goal(*UP)
    assert world.verdict(stamp).code is Verdict.OK
    ending = world.execution_report(stamp)
    assert ending.outcome is Outcome.REACHED
    assert ending.attempts == 1
    assert ending.plan_stamp_ns == world.verdict(stamp).plan.plan_stamp_ns
    assert world.tip_is_at(*UP)
    assert world.is_idle


def test_a_goal_in_motion_replaces_the_one_before_when_the_arm_has_confirmed(world):
    first = under_way(world)
    second = world.send_goal(*DOWN)
    assert world.verdict(second).code is Verdict.OK
    assert world.execution_reports(first) == []
    assert world.execution_report(first).outcome is Outcome.REPLACED
    assert world.execution_report(second).outcome is Outcome.REACHED


def test_a_sent_plan_is_freed_once_the_arm_follows_a_newer_one(world):
    sent = []
    for goal in (UP, DOWN):
        world.send_goal(*goal)
        world.pass_time_until(lambda: world.life.state.unconfirmed is not None)
        sent.append(weakref.ref(world.life.state.unconfirmed))
        world.pass_time_until(lambda: world.life.state.unconfirmed is None)
    gc.collect()
    assert [each() is None for each in sent] == [True, False]


@pytest.mark.parametrize("pace", [0.3, 0.9])
def test_goals_are_planned_and_reached_while_the_arm_is_slowed_and_later_than_planned(world, pace):
    first = under_way(world)
    world.arm.speed_scaling = pace
    world.pass_time(1.0)
    second = world.send_goal(*DOWN)
    assert world.verdict(second).code is Verdict.OK
    assert world.execution_report(first).outcome is Outcome.REPLACED
    world.arm.speed_scaling = 1.0
    world.pass_time(0.5)
    third = world.send_goal(*UP)
    ending = world.execution_report(third)
    assert ending.outcome is Outcome.REACHED
    assert ending.attempts == 1
    assert world.execution_report(second).outcome is Outcome.REPLACED
    assert world.tip_is_at(*UP)
    assert max(world.arm.jumps) < 1e-6
    again = world.send_goal(*DOWN)
    assert world.execution_report(again).outcome is Outcome.REACHED


def test_goals_passed_over_are_superseded_and_the_newest_is_executed(world):
    stamps = [world.send_goal(0.6, 0.1 + 0.01 * k) for k in range(10)]
    codes = [world.verdict(stamp).code for stamp in stamps]
    assert codes == [Verdict.OK, *[Verdict.SUPERSEDED] * 8, Verdict.OK]
    assert world.execution_report(stamps[0]).outcome is Outcome.REPLACED
    assert world.execution_report(stamps[-1]).outcome is Outcome.REACHED


def test_the_lead_counts_from_the_goals_arrival_to_the_change(world):
    first = under_way(world)
    lead_ms = world.verdict(world.send_goal(*DOWN)).plan.lead_ms
    change_ns = world.life.state.execution and world.sent[-1]
    assert change_ns is not None
    assert 1e3 * world.planning_time < lead_ms < 150.0
    assert world.verdict(first).plan.lead_ms > 0.0


# --- Late and refused plans -----------------------------------------------------------------------


def test_a_plan_that_the_arm_refuses_as_late_is_made_again_with_a_longer_lead(world):
    under_way(world)
    world.transport = 0.15
    second = world.send_goal(*DOWN)
    world.pass_time_until(lambda: len(world.sent) == 2)
    world.transport = 0.002
    assert world.execution_report(second).outcome is Outcome.REACHED
    assert world.execution_report(second).attempts > 1
    leads = [request.commit_horizon for request in world.planned[1:]]
    assert leads[1] >= 1.5 * leads[0] * (1 - 1e-9)
    assert world.execution_report(second).plan_stamp_ns > world.verdict(second).plan.plan_stamp_ns
    assert max(world.arm.jumps) <= 1e-6


def test_a_plan_that_gets_lost_is_made_again(world):
    first = under_way(world)
    world.lost = 1
    second = world.send_goal(*DOWN)
    assert world.execution_report(second).outcome is Outcome.REACHED
    assert world.execution_report(second).attempts == 2
    assert world.execution_report(first).outcome is Outcome.REPLACED


def test_from_rest_a_lost_plan_is_only_stamped_anew(world):
    world.lost = 1
    stamp = world.send_goal(*UP)
    assert world.execution_report(stamp).attempts == 2
    assert len(world.planned) == 1
    first, again = (command.trajectory for command in world.sent)
    np.testing.assert_array_equal(first.position[-500:], again.position[-500:])
    assert again.stamp_ns > first.stamp_ns


def test_after_a_plan_stamped_too_far_ahead_of_a_slow_arm_its_goal_waits_for_that_stamp(
    new_world,
):
    world = new_world(lead_max=0.2)
    world.life.hand_over.horizon_estimator.add_first_motion(1.0)
    world.pass_time(3.0)
    world.arm.clock_rate = 0.02
    world.pass_time(0.95)
    stamp = world.send_goal(*UP)
    world.pass_time(0.3)
    world.arm.clock_rate = 1.0
    ending = world.execution_report(stamp)
    assert ending.outcome is Outcome.REACHED, ending
    assert ending.attempts == 2
    first, again = (command.stamp_ns for command in world.sent)
    assert first < again
    assert len(world.planned) == 2


def test_a_plan_is_not_given_up_before_the_time_of_a_slow_arm_has_come_to_it(world):
    world.pass_time(3.0)
    world.arm.clock_rate = 0.1
    world.pass_time(0.3)
    stamp = world.send_goal(*UP)
    world.pass_time(0.9)
    world.arm.clock_rate = 1.0
    ending = world.execution_report(stamp)
    assert (ending.outcome, ending.attempts) == (Outcome.REACHED, 1), ending


def test_only_a_plan_from_rest_may_begin_later_and_not_before_the_motion_that_it_continues(world):
    def rehearse():
        request = world.life.planning.build_trial_request(Goal(1, *DOWN), keep_settings)
        return request.make_plan(world.replanner)

    resting = rehearse()
    end_ns = resting.previous_command.trajectory.end_ns
    assert resting.starts_from_rest
    assert resting.with_stamp(end_ns - 1, 0.1) is None
    again = resting.with_stamp(end_ns + SECOND_NS, 0.1)
    assert again.command.stamp_ns == end_ns + SECOND_NS
    assert again.change_ns - again.command.stamp_ns == SECOND_NS // 10
    under_way(world)
    assert not rehearse().starts_from_rest


def test_a_refused_plan_replaces_nothing_and_the_arm_can_be_stopped_all_the_same(world):
    first = under_way(world)
    world.lost = 99
    world.send_goal(*DOWN)
    world.pass_time(0.3)
    assert world.life.arm_state.plan_in_force_ns == world.verdict(first).plan.plan_stamp_ns
    world.lost = 0
    answers = []
    world.life.stop(lambda *answer: answers.append(answer))
    world.pass_time_until(lambda: bool(answers))
    world.pass_time(3.0)
    assert answers[0][0]
    assert not world.arm.is_moving
    assert not world.tip_is_at(*UP)
    assert not world.tip_is_at(*DOWN)


def test_after_a_refused_plan_a_zone_across_the_way_stops_the_arm_all_the_same(world):
    first = under_way(world)
    world.lost = 99
    second = world.send_goal(*DOWN)
    world.pass_time(0.3)
    world.lost = 0
    settings = across_the_way(world)
    world.life.change_settings(settings)
    closest = np.inf
    for _ in range(200):
        world.pass_time(0.02)
        closest = min(closest, settings.machine.clearance(world.arm.reference.position)[0])
    assert closest > 0.0
    assert not world.tip_is_at(*UP)
    world.pass_time_until(lambda: world.is_idle)
    assert world.execution_report(first).outcome in (Outcome.STOPPED, Outcome.REPLACED)
    assert world.verdict(second).code in (Verdict.OK, Verdict.INFEASIBLE)


def test_planning_that_never_comes_in_time_ends_with_not_found_or_deadline(new_world):
    world = new_world(lead_max=0.1)
    under_way(world)
    world.planning_time = 0.5
    stamp = world.send_goal(*DOWN)
    verdict = world.verdict(stamp)
    assert verdict.code is Verdict.DEADLINE
    assert re.search(r"3 tries at the longest commit horizon, \d+\.\d s in all", verdict.sentence)
    world.execution_report(1)
    world.check_that_each_goal_was_answered_once()


def test_an_accepted_goal_whose_plans_are_never_taken_is_aborted_with_the_reason(new_world):
    world = new_world(lead_max=0.2)
    first = under_way(world)
    world.lost = 99
    second = world.send_goal(*DOWN)
    assert world.verdict(second).code is Verdict.OK
    ending = world.execution_report(second)
    assert (ending.outcome, ending.reason) == (Outcome.ABORTED, Verdict.DEADLINE)
    assert ending.attempts >= 3
    assert world.execution_report(first).outcome is Outcome.REACHED


def test_a_confirmation_that_comes_late_counts_all_the_same(world):
    first = under_way(world)
    second = world.send_goal(*DOWN)
    world.pass_time_until(lambda: len(world.sent) == 2)
    world.arm.frozen = True
    world.pass_time(1.5)
    world.arm.frozen = False
    assert world.execution_report(second).outcome is Outcome.REACHED
    assert world.execution_report(first).outcome is Outcome.REPLACED
    world.check_that_each_goal_was_answered_once()


def test_a_plan_taken_late_goes_on_if_its_repetition_is_refused_while_a_newer_goal_waits(world):
    world.lost = 2
    first = world.send_goal(*UP)
    world.pass_time_until(lambda: len(world.sent) == 2)
    world.life.handle_plan_in_force(world.sent[0].stamp_ns)
    newer = world.send_goal(*DOWN)
    world.life.handle_plan_refusal(world.sent[1].stamp_ns, HandOverReason.LATE, "too late")
    assert world.execution_reports(first) == []
    assert world.life.state.execution.replan.command is world.sent[0]
    assert len(world.planned) == 2
    assert world.planned[1].pending_goal.goal.stamp_ns == newer


def test_a_plan_is_not_given_up_while_the_arm_is_silent(world):
    stamp = world.send_goal(*UP)
    world.pass_time_until(lambda: world.sent)
    world.arm.frozen = True
    world.pass_time(0.5)
    assert world.life.state.unconfirmed.command is world.sent[-1]
    world.arm.frozen = False
    assert world.execution_report(stamp).outcome is Outcome.REACHED
    assert len(world.sent) == 1


def test_the_lead_falls_again_when_load_ends(world):
    def lead_after(goals: int) -> float:
        for k in range(goals):
            world.send_goal(0.6, 0.1 * (-1) ** k)
            world.pass_time(0.7)
        return world.life.hand_over.horizon_estimator.horizon

    idle = lead_after(20)
    world.transport = 0.08
    loaded = lead_after(10)
    world.transport = 0.002
    assert loaded > 2 * idle
    assert lead_after(20) <= 1.2 * idle


def test_a_fixed_planning_budget_is_the_lead(new_world):
    world = new_world(planning_budget=0.3)
    under_way(world)
    world.verdict(world.send_goal(*DOWN))
    assert world.planned[-1].commit_horizon == pytest.approx(0.3)


def test_the_dead_time_of_a_machine_without_pressure_sensors_is_added(new_world):
    world = new_world(planning_budget=0.3)
    blind = {"imperfections.sensors.pressure": "none", "imperfections.computing_delay": 0.15}
    slow = world.machine.with_values(blind)
    world.life.change_settings(replace(world.life.state.settings, machine=slow))
    dead = compute_dead_time(slow)
    assert dead > 0.15
    under_way(world)
    verdict = world.verdict(world.send_goal(*DOWN))
    assert verdict.code is Verdict.OK
    assert world.planned[-1].commit_horizon == pytest.approx(0.3 + dead)
    assert verdict.plan.lead_ms == pytest.approx(1e3 * (0.3 + dead), abs=30.0)


def test_a_moving_goal_is_extrapolated_in_real_time(new_world, monkeypatch):
    durations = []

    def record(stream, goal, age, horizon, dead_time):
        durations.append((horizon, dead_time))
        return goal

    monkeypatch.setattr(GoalStream, "extrapolate", record)
    world = new_world(planning_budget=0.3)
    slow = world.machine.with_values({"imperfections.sensors.pressure": "none"})
    world.life.change_settings(replace(world.life.state.settings, machine=slow))
    world.arm.clock_rate = 10.0
    world.pass_time(4.0)
    for height in (0.10, 0.11, 0.12):
        world.send_goal(0.55, height)
        world.pass_time(0.05)
    assert durations[-1] == pytest.approx((0.3, compute_dead_time(slow) / 10.0), rel=1e-3)


def test_an_arm_that_runs_faster_is_given_its_own_time(world):
    world.arm.clock_rate = 10.0
    world.pass_time(4.0)
    under_way(world, seconds=0.1)
    second = world.send_goal(*DOWN)
    assert world.execution_report(second).outcome is Outcome.REACHED
    assert world.planned[-1].commit_horizon > 5 * world.life.hand_over.horizon_estimator.horizon


@pytest.mark.parametrize(
    ("left_over", "frozen", "ahead"),
    [(0.4, 0.45, 0.0), (0.4, 0.7, 0.0), (0.4, 1.5, 0.0), (0.4, 0.7, 5.0), (2.0, 0.7, 5.0)],
)
def test_an_arm_that_froze_before_its_motion_ended_is_not_taken_to_rest(
    world, left_over, frozen, ahead
):
    world.ros_ahead = ahead
    first = under_way(world)
    left = (world.arm.command.trajectory.end_ns - world.arm.time_ns) / SECOND_NS
    world.pass_time(left - left_over)
    world.arm.frozen = True
    world.pass_time(frozen)
    second = world.send_goal(*DOWN)
    world.pass_time(0.01)
    world.arm.frozen = False
    assert world.verdict(second).code is Verdict.OK
    assert world.execution_report(second).outcome is Outcome.REACHED
    assert world.execution_report(first).outcome in (Outcome.REPLACED, Outcome.REACHED)
    world.check_that_nothing_sent_jumps()


# --- Stopping -------------------------------------------------------------------------------------


@pytest.mark.parametrize("after", [0.0, 0.01, 0.021, 0.024, 0.03, 0.06])
def test_a_stop_ends_goals_that_are_being_planned_for_or_sent(world, after):
    stamp = world.send_goal(*UP)
    world.pass_time(after)
    answers = []
    world.life.stop(lambda *answer: answers.append(answer))
    world.pass_time_until(lambda: bool(answers))
    position = world.arm.command.trajectory.position[-1]
    world.pass_time(3.0)
    assert answers[0][0]
    np.testing.assert_array_equal(world.arm.reference.position, position)
    assert not world.arm.is_moving
    [verdict] = world.verdicts(stamp)
    if verdict.code is Verdict.OK:
        assert world.execution_report(stamp).outcome is Outcome.STOPPED
    else:
        assert verdict.code is Verdict.STOPPED
        assert world.execution_reports(stamp) == []
    assert world.is_idle


def test_a_stop_whose_command_gets_lost_is_sent_again_and_then_asked_of_the_arm(world):
    stamp = under_way(world)
    world.lost = 99
    answers = []
    world.life.stop(lambda *answer: answers.append(answer))
    world.pass_time_until(lambda: bool(answers))
    assert answers[0][0]
    assert world.asked_arm_to_stop == 1
    assert world.execution_report(stamp).outcome is Outcome.STOPPED
    assert not world.arm.is_moving


def test_beside_another_planner_the_arm_itself_is_asked_to_stop_and_its_rest_is_measured(world):
    stamp = under_way(world)
    world.has_other_planner = True
    answers = []
    world.life.stop(lambda *answer: answers.append((*answer, world.arm.is_moving)))
    world.pass_time_until(lambda: bool(answers))
    assert answers == [(True, "the arm stands still", False)]
    assert world.asked_arm_to_stop == 1
    assert world.execution_report(stamp).outcome is Outcome.STOPPED


def test_rest_is_measured_after_the_arm_was_asked_to_stop(world):
    world.send_goal(*UP)
    world.pass_time_until(lambda: world.arm.is_moving)
    world.has_other_planner = True
    answers = []
    world.life.stop(lambda *answer: answers.append(answer))
    called = world.steady_time()
    world.pass_time_until(lambda: bool(answers))
    assert answers[0][0]
    assert world.steady_time() - called >= REST_TIME


def test_a_frozen_arm_that_takes_a_revoked_plan_afterwards_is_braked_at_once(world):
    first = under_way(world)
    world.send_goal(*DOWN)
    world.pass_time_until(lambda: len(world.sent) == 2)
    world.arm.frozen = True
    answers = []
    world.life.stop(lambda *answer: answers.append(answer))
    world.pass_time(1.0)
    world.arm.frozen = False
    world.pass_time_until(lambda: bool(answers))
    world.pass_time(3.0)
    assert not world.arm.is_moving
    assert world.execution_report(first).outcome in (Outcome.STOPPED, Outcome.REPLACED)
    world.check_that_each_goal_was_answered_once()


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("after", [0.0, 0.01, 0.02, 0.025, 0.03, 0.06])
def test_when_somebody_stops_the_arm_goals_that_had_come_are_void(world, moving, after):
    first = under_way(world) if moving else None
    stamp = world.send_goal(*DOWN)
    world.pass_time(after)
    world.arm.stop_at_once()
    world.pass_time(3.0)
    resting = world.arm.reference.position
    world.pass_time(5.0)
    np.testing.assert_array_equal(world.arm.reference.position, resting)
    assert world.is_idle
    [verdict] = world.verdicts(stamp)
    if verdict.code is Verdict.OK:
        assert world.execution_report(stamp).outcome is Outcome.STOPPED
    else:
        assert (verdict.code, verdict.sentence) == (Verdict.STOPPED, "the arm was asked to stop")
    if first is not None:
        assert world.execution_report(first).outcome in (Outcome.STOPPED, Outcome.REPLACED)
    assert world.execution_report(world.send_goal(*UP)).outcome is Outcome.REACHED


def test_a_goal_that_came_before_the_arm_was_stopped_is_void_also_when_it_is_read_later(world):
    came = world.steady_time()
    world.pass_time(0.01)
    world.arm.stop_at_once()
    world.pass_time(0.05)
    world.life.add_goal(Goal(1, *DOWN), came)
    assert world.verdict(1).code is Verdict.STOPPED
    assert not world.planned


def test_a_goal_that_came_before_the_planner_was_stopped_is_void_also_when_it_is_read_later(world):
    came = world.steady_time()
    world.pass_time(0.01)
    world.life.stop(lambda *answer: None)
    world.life.add_goal(Goal(1, *DOWN), came)
    verdict = world.verdict(1)
    assert (verdict.code, verdict.sentence) == (Verdict.STOPPED, "the planner was asked to stop")
    world.pass_time(2.0)
    assert not world.planned
    assert world.execution_report(world.send_goal(*UP)).outcome is Outcome.REACHED


def test_a_goal_that_was_sent_before_a_stop_is_void_though_it_comes_after_it(world):
    sent = world.steady_time()
    world.pass_time(0.08)
    answers = []
    world.life.stop(lambda *answer: answers.append(answer))
    world.pass_time_until(lambda: bool(answers))
    world.life.add_goal(Goal(1, *DOWN), world.steady_time(), sent)
    verdict = world.verdict(1)
    assert (verdict.code, verdict.sentence) == (Verdict.STOPPED, "the planner was asked to stop")
    world.pass_time(2.0)
    assert not world.planned


@pytest.mark.parametrize(("suspended", "code"), [(0.4, Verdict.STOPPED), (0.02, Verdict.OK)])
def test_a_goal_read_right_after_the_report_of_a_stop_is_void_if_the_planner_was_suspended(
    world, suspended, code
):
    stop_ns = world.arm.clock_ns
    world.pass_time(suspended)
    world.life.handle_arm_stop(stop_ns, received_at=world.steady_time())
    world.pass_time(0.02)
    world.life.add_goal(Goal(77, *DOWN), world.steady_time())
    assert world.verdict(77).code is code
    world.pass_time(0.2)
    assert world.execution_report(world.send_goal(*UP)).outcome is Outcome.REACHED


def test_a_plan_that_the_arm_took_after_somebody_had_stopped_it_is_braked(world):
    stamp = under_way(world, seconds=0.02)
    world.life.handle_arm_stop(world.arm.time_ns)
    world.pass_time_until(lambda: not world.arm.is_moving)
    assert world.execution_report(stamp).outcome is Outcome.STOPPED
    assert not world.tip_is_at(*UP)
    assert max(world.arm.jumps) <= 1e-6


def test_a_stop_of_long_ago_voids_no_goal(world):
    world.life.add_goal(Goal(1, *DOWN))
    world.life.handle_arm_stop(world.arm.time_ns - 3 * SECOND_NS)
    assert world.verdict(1).code is Verdict.OK


def test_a_stop_of_long_ago_voids_no_goal_though_the_first_states_received_are_old(world):
    world.life.add_goal(Goal(1, *DOWN))
    clock, now = world.life.arm_state.clock_estimator, world.steady_time()
    clock.forget()
    clock.add_stamp(world.arm.clock_ns - 3 * SECOND_NS, now)
    world.life.handle_arm_stop(world.arm.clock_ns - 4 * SECOND_NS, age=4.0)
    assert world.verdict(1).code is Verdict.OK


def test_the_first_report_voids_no_goal_that_came_after_the_stop(world):
    planner = ArmStops(world.life.state)
    half_ago, now = world.arm.clock_ns - SECOND_NS // 2, world.steady_time()
    assert planner.find_void_time(half_ago, 0.5) == pytest.approx(now - 0.5, abs=0.01)
    assert planner.find_void_time(half_ago + 1, 0.5) > now


def test_the_report_of_a_stop_of_long_ago_is_not_taken_for_that_of_an_own_call(world):
    under_way(world)
    world.lost = 99
    world.life.stop(lambda *answer: None)
    world.pass_time_until(lambda: world.asked_arm_to_stop == 1)
    world.lost = 0
    world.life.handle_arm_stop(world.arm.clock_ns - 9 * SECOND_NS, age=9.0)
    assert world.execution_report(world.send_goal(*DOWN)).outcome is Outcome.REACHED


def test_a_goal_after_a_stop_goes_on_from_there(world):
    under_way(world)
    world.life.stop(lambda *answer: None)
    second = world.send_goal(*DOWN)
    assert world.execution_report(second).outcome is Outcome.REACHED
    assert max(world.arm.jumps) <= 1e-6


# --- Settings, clock, faults ----------------------------------------------------------------------


def test_a_plan_that_is_being_made_is_made_anew_with_new_settings(world):
    stamp = world.send_goal(*UP)
    world.pass_time(0.01)
    old = world.life.state.settings
    changed = Settings(old.machine.changed(payload=0.0), old.options)
    world.life.change_settings(changed)
    assert world.verdict(stamp).code is Verdict.OK
    assert [request.settings for request in world.planned] == [old, changed]


def test_a_goal_that_nothing_is_left_to_lift_to_is_refused_for_what_is_lost(world):
    old = world.life.state.settings
    without = old.machine.changed(module_count=0)
    world.life.change_settings(replace(old, machine=without, lost_servo_pumps=(1, 2, 3, 4)))
    verdict = world.verdict(world.send_goal(*STRETCHED))
    assert verdict.code is Verdict.INFEASIBLE
    assert verdict.sentence.endswith("; the arm does without servo pump 1, 2, 3, 4")
    world.life.change_settings(old)
    assert world.verdict(world.send_goal(*STRETCHED)).code is Verdict.OK


def test_the_same_goal_again_goes_on_without_a_new_plan(world):
    first = under_way(world)
    second = world.send_goal(*UP)
    verdict = world.verdict(second)
    assert (verdict.code, verdict.plan.continued) == (Verdict.OK, True)
    assert verdict.plan.plan_stamp_ns == world.verdict(first).plan.plan_stamp_ns
    assert world.execution_report(first).outcome is Outcome.REPLACED
    assert world.execution_report(second).outcome is Outcome.REACHED
    assert len(world.sent) == 1


def test_when_the_clock_goes_back_goals_are_planned_anew_from_the_new_state(world):
    first = under_way(world)
    second = world.send_goal(*DOWN)
    world.pass_time(0.01)
    world.arm.restart(5 * SECOND_NS)
    world.life.handle_clock_jump("the clock went back")
    verdict = world.verdict(second)
    assert verdict.code is Verdict.OK
    assert verdict.plan.plan_stamp_ns < 20 * SECOND_NS
    assert world.execution_report(first).outcome is Outcome.ABORTED
    assert world.execution_report(second).outcome is Outcome.REACHED


def test_a_goal_after_a_clock_jump_does_not_wait_for_a_report_that_came_before_the_jump(world):
    under_way(world)
    world.arm.restart(5 * SECOND_NS)
    world.life.handle_plan_in_force(NO_PLAN)  # without a stamp: it shows no jump
    world.life.handle_reference(world.arm.reference, world.arm.clock_ns)
    world.in_force_delay = 1.0
    began = world.now
    second = world.send_goal(*DOWN)
    assert world.verdict(second).code is Verdict.OK
    assert world.now - began < 0.5
    assert world.life.state.unconfirmed.command is world.sent[-1]  # silence is no confirmation


def test_while_the_arm_reports_a_fault_goals_are_refused_with_its_sentence(world):
    first = under_way(world)
    second = world.send_goal(*DOWN)
    world.arm.fault = "joint_1 is 0.2 rad behind"
    world.arm.stop_at_once()
    assert world.verdict(second).code is Verdict.FAULT
    assert world.verdict(second).sentence == "joint_1 is 0.2 rad behind"
    ending = world.execution_report(first)
    assert (ending.outcome, ending.reason) == (Outcome.ABORTED, Verdict.FAULT)
    third = world.send_goal(*DOWN)
    assert world.verdict(third).code is Verdict.FAULT
    world.arm.fault = ""
    world.pass_time(0.1)
    assert world.execution_report(world.send_goal(*DOWN)).outcome is Outcome.REACHED


def test_without_a_state_a_goal_waits_and_is_then_refused(world):
    world.arm.frozen = True
    world.pass_time(1.0)
    stamp = world.send_goal(*UP)
    began = world.now
    assert world.verdict(stamp).code is Verdict.NO_STATE
    assert 1.9 < world.now - began < 2.2


def test_of_an_arm_that_ended_in_motion_no_state_is_known(world):
    first = under_way(world)
    world.arm.frozen = True
    world.pass_time(2.5)
    sent, stamp = len(world.sent), world.send_goal(*DOWN)
    began = world.now
    assert world.verdict(stamp).code is Verdict.NO_STATE
    assert 1.9 < world.now - began < 2.2
    assert len(world.sent) == sent
    world.ros_ahead = 30.0  # the ROS clock goes on
    ending = world.execution_report(first)
    assert ending.outcome is Outcome.ABORTED
    assert "nothing has been heard of the arm for " in ending.sentence


def test_an_arm_moved_by_somebody_else_is_asked_to_stop_first(world):
    other = under_way(world)
    world.life.handle_clock_jump("the planner was started anew")  # it forgets its own command
    world.execution_reports(other)
    second = world.send_goal(*DOWN)
    assert world.execution_report(second).outcome is Outcome.REACHED
    assert world.asked_arm_to_stop == 1


def test_goals_out_of_the_workspace_leave_the_motion_as_it_is(world):
    first = under_way(world)
    assert world.verdict(world.send_goal(2.0, 0.0)).code is Verdict.OUT_OF_WORKSPACE
    assert world.verdict(world.send_goal(0.0, 0.3)).code is Verdict.INFEASIBLE
    assert world.execution_report(first).outcome is Outcome.REACHED


def test_a_goal_that_has_been_reached_is_accepted_and_costs_nothing(world):
    world.execution_report(world.send_goal(*UP))
    sent = len(world.sent)
    verdict = world.verdict(world.send_goal(*UP))
    assert (verdict.code, verdict.plan.energy_j) == (Verdict.AT_GOAL, 0.0)
    assert len(world.sent) == sent
    assert world.arm.in_force_ns == NO_PLAN


def test_a_goal_waits_until_the_arm_receives_plans(world):
    world.reachable = False
    stamp = world.send_goal(*UP)
    world.pass_time(1.0)
    assert world.planned == []
    world.reachable = True
    assert world.execution_report(stamp).outcome is Outcome.REACHED


def test_right_after_its_first_state_an_arm_is_given_more_time_to_receive_plans(world):
    world.reachable = False
    stamp = world.send_goal(*UP)
    world.pass_time(4.0)
    assert not world.sent
    world.reachable = True
    assert world.execution_report(stamp).outcome is Outcome.REACHED
    assert len(world.sent) == 1


def test_an_arm_that_tells_a_reference_is_given_time_to_tell_the_plan_in_force(world):
    world.life.arm_state.plan_in_force_ns = None
    world.life.add_goal(Goal(7, *UP))
    assert world.planned == []
    world.pass_time(0.01)
    assert len(world.planned) == 1


@pytest.mark.parametrize(("seconds", "count"), [(2.0, 0), (8.0, 1)])
def test_an_arm_is_not_said_to_be_silent_on_its_machine_before_it_had_time_to_report(
    new_world, seconds, count
):
    world = new_world()
    world.pass_time(seconds)
    world.life.arm_state.machine_difference = None
    stamp = world.send_goal(*UP)
    assert world.verdict(stamp).code is Verdict.OK
    assert sum("does not report its machine" in each for each in world.warnings) == count
