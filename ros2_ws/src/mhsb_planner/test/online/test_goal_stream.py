"""Goals that stream: the velocity that is told from them, and what becomes of each."""

import itertools

import numpy as np
import pytest
from benchmarks.lock_step import LockStepWorld
from benchmarks.streaming_benchmark import lines

from mhsb_model.goal import Goal
from mhsb_model.verdict import Outcome, Verdict
from mhsb_planner.online.goal_stream import MAX_LOOKAHEAD_TIME, GoalStream
from mhsb_planner.online.replanning import Replanner
from mhsb_planner.online.settings import Settings
from mhsb_planner.planners.options import PlanOptions


def heard(samples: list[tuple[float, float, float]]) -> GoalStream:
    stream = GoalStream()
    for x, z, time in samples:
        stream.add_goal(Goal(0, x, z), time)
    return stream


def moving(velocity: tuple[float, float], times: list[float]) -> GoalStream:
    return heard([(0.5 + velocity[0] * t, 0.1 + velocity[1] * t, t) for t in times])


@pytest.mark.parametrize("times", [[1.0, 1.1, 1.2], [3.0, 3.02, 3.05, 3.09, 3.1, 3.15]])
def test_the_velocity_of_an_evenly_moving_goal_is_told_whatever_the_times_between(times):
    stream = moving((0.03, -0.04), times)
    np.testing.assert_allclose(stream.velocity, (0.03, -0.04), atol=1e-12)
    assert stream.is_moving(times[-1])


def test_with_jitter_of_arrival_the_velocity_is_that_of_the_straight_line_of_least_squares():
    random = np.random.default_rng(0)
    times = 0.05 * np.arange(5)
    late = times + random.uniform(0.0, 0.01, 5)
    stream = heard([(0.1 * t, 0.0, when) for t, when in zip(times, late, strict=True)])
    slope = np.polyfit(late, 0.1 * times, 1)[0]
    assert stream.velocity[0] == pytest.approx(slope)


def test_two_goals_and_goals_far_apart_or_at_one_place_do_not_move():
    assert not moving((0.1, 0.0), [1.0, 1.1]).is_moving(1.1)
    assert not moving((0.1, 0.0), [1.0, 2.0, 3.0, 4.0]).is_moving(4.0)
    assert not moving((0.0, 0.0), [1.0, 1.1, 1.2]).is_moving(1.2)


def test_a_goal_elsewhere_is_another_one():
    stream = moving((0.1, 0.0), [1.0, 1.1, 1.2])
    stream.add_goal(Goal(0, 0.9, 0.4), 1.3)
    assert stream.velocity == (0.0, 0.0)


def test_a_goal_that_comes_no_more_moves_no_more():
    stream = moving((0.1, 0.0), [1.0, 1.1, 1.2])
    assert stream.is_moving(1.3)
    assert not stream.is_moving(1.4)


@pytest.mark.parametrize("dead_time", [0.0, 0.25])
@pytest.mark.parametrize("age", [0.0, 0.04])
@pytest.mark.parametrize(("commit_horizon", "ahead"), [(0.02, MAX_LOOKAHEAD_TIME), (-0.05, 0.05)])
def test_a_plan_ends_where_the_goal_will_be_a_little_later(age, dead_time, commit_horizon, ahead):
    stream = moving((0.1, 0.0), [1.0, 1.1, 1.2])
    last = Goal(7, 0.62, 0.1)
    led = stream.extrapolate(last, age, commit_horizon, dead_time)
    assert led.stamp_ns == 7
    assert led.x - last.x == pytest.approx(0.1 * (age + dead_time + ahead))


def follow(world, speed, rate, seconds):
    """Send a goal that moves upwards; where it is at last, and the stamps."""
    stamps = []
    for k in range(1, 1 + round(seconds * rate)):
        z = 0.1 + speed * k / rate
        stamps.append(world.send_goal(0.55, z))
        world.pass_time(1.0 / rate)
    return z, stamps


@pytest.mark.parametrize("planner", ["table", "fixed", "integrated"])
def test_when_a_moving_goal_stops_the_arm_rests_exactly_there_and_each_goal_is_answered_once(
    new_world, planner
):
    world = new_world(planner)
    world.execution_report(world.send_goal(0.55, 0.1))
    z, stamps = follow(world, 0.05, 20.0, 2.0)
    highest = [0.0]

    def ended():
        highest[0] = max(highest[0], world.machine.tip_position(world.arm.reference.position)[1])
        return bool(world.execution_reports(stamps[-1]))

    world.pass_time_until(ended)
    assert highest[0] <= z + 0.05 * MAX_LOOKAHEAD_TIME + 3e-4
    assert world.execution_report(stamps[-1]).outcome is Outcome.REACHED
    x_rest, z_rest = world.machine.tip_position(world.arm.reference.position)
    assert np.hypot(x_rest - 0.55, z_rest - z) < 2e-4
    world.check_that_each_goal_was_answered_once()
    assert max(world.arm.jumps) <= 1e-6


def test_where_goals_come_seldom_the_arm_rests_exactly_at_the_last_one_too(new_world):
    world = new_world("integrated")
    world.execution_report(world.send_goal(0.55, 0.1))
    z, stamps = follow(world, 0.03, 5.0, 2.0)
    assert world.execution_report(stamps[-1]).outcome is Outcome.REACHED
    x_rest, z_rest = world.machine.tip_position(world.arm.reference.position)
    assert np.hypot(x_rest - 0.55, z_rest - z) < 2e-4
    world.check_that_each_goal_was_answered_once()


@pytest.mark.parametrize("by_the_planner", [False, True])
def test_an_arm_stopped_while_a_goal_moves_stays_stopped(new_world, by_the_planner):
    world = new_world("integrated")
    world.execution_report(world.send_goal(0.55, 0.1))
    follow(world, 0.05, 20.0, 1.0)
    if by_the_planner:
        world.life.stop(lambda *answer: None)
    else:
        world.arm.stop_at_once()
    world.pass_time(1.0)
    resting = world.arm.reference.position
    world.pass_time(3.0)
    np.testing.assert_array_equal(world.arm.reference.position, resting)
    assert world.is_idle
    world.check_that_each_goal_was_answered_once()


def test_at_fifty_goals_a_second_plans_are_finished_and_the_newest_goal_follows(new_world):
    world = new_world("integrated", lead_min=0.03)
    world.execution_report(world.send_goal(0.55, 0.1))
    planned = len(world.planned)
    _, stamps = follow(world, 0.05, 50.0, 1.0)
    world.execution_report(stamps[-1])
    codes = [world.verdict(stamp).code for stamp in stamps]
    assert set(codes) <= {Verdict.OK, Verdict.SUPERSEDED}
    assert codes.count(Verdict.OK) > 20
    assert len(world.planned) - planned > 20
    world.check_that_each_goal_was_answered_once()


class UnevenWorld(LockStepWorld):
    """Planning takes now a few milliseconds, now much longer."""

    random = np.random.default_rng(0)

    @property
    def planning_time(self):
        slow = self.random.random() < 0.25
        return self.random.uniform(0.015, 0.05) if slow else self.random.uniform(0.003, 0.008)

    @planning_time.setter
    def planning_time(self, _):
        """It is drawn."""


@pytest.mark.slow
@pytest.mark.parametrize(("number", "seed"), [(1, 3), (3, 3), (4, 1)])
def test_however_long_plans_take_the_arm_does_not_swing_far_beyond_where_a_goal_stops(
    machine, table, number, seed
):
    """Plans that were free to take another posture swung the tip by up to 26 mm."""
    [line] = itertools.islice(lines(machine, 0.1), number, number + 1)
    world = UnevenWorld(
        machine, Replanner(machine, table), Settings(machine, PlanOptions(planner="integrated"))
    )
    world.random = np.random.default_rng(seed)
    world.send_goal(*line.begin.tolist())
    world.pass_time_until(lambda: world.tip_is_at(*line.begin.tolist()), 30.0)
    began = world.now
    while (passed := world.now - began) * 0.1 < line.length:
        goal = line.point_at(0.1 * passed)
        world.send_goal(*goal.tolist())
        world.pass_time(0.05)
    ahead = (line.end - line.begin) / line.length
    beyond = 0.0
    while not world.tip_is_at(*goal.tolist()):
        world.pass_time(world.step)
        tip = machine.tip_position(world.arm.reference.position)
        beyond = max(beyond, float((tip - goal) @ ahead))
    assert beyond < 4e-3
