"""Points on the way of goals that follow each other: each is passed once between two rests."""

import numpy as np
import pytest

from mhsb_model.verdict import Outcome, Verdict
from mhsb_planner.motion.via_check import describe_first_missed
from mhsb_planner.online.settings import Settings
from mhsb_planner.planner import PlanOptions

VIA = (0.50, 0.00), (0.62, 0.15)
TOLERANCE = 0.012
GOAL, OTHER = (0.65, 0.40), (0.60, 0.45)
ALL = tuple((x, z, TOLERANCE + 1e-3) for x, z in VIA)


class Traced:
    """A world whose arm has points to pass, and the way of its tip, every 5 ms."""

    def __init__(self, new_world, planner):
        self.world, self.tips = new_world(planner), []
        self.set(planner=planner, via=VIA, via_tolerance=TOLERANCE)

    def set(self, **options):
        settings = Settings(self.world.machine, PlanOptions(**options))
        self.world.life.change_settings(settings)

    def until(self, condition, longest=40.0):
        def look():
            posture = self.world.arm.reference.position
            self.tips.append(self.world.machine.tip_position(posture))
            return condition()

        self.world.pass_time_until(look, longest)

    def away(self, point):
        tip = self.world.machine.tip_position(self.world.arm.reference.position)
        return float(np.hypot(*(tip - point)))

    def check_passed(self, points=ALL):
        assert describe_first_missed(np.array(self.tips), points) == ""

    def visits(self, point, near=0.03):
        """How often the tip came near a point."""
        close = np.hypot(*(np.array(self.tips) - point).T) < near
        return int(close[0]) + int(np.count_nonzero(close[1:] & ~close[:-1]))


@pytest.fixture
def traced(new_world):
    return Traced(new_world, "integrated")


@pytest.mark.parametrize("planner", ["table", "integrated"])
def test_a_goal_that_comes_on_the_way_is_reached_by_the_points_that_are_left(new_world, planner):
    traced = Traced(new_world, planner)
    world = traced.world
    first = world.send_goal(*GOAL)
    traced.until(lambda: traced.away(VIA[0]) < 0.01)
    traced.until(lambda: traced.away(VIA[0]) > 0.05)
    second = world.send_goal(*OTHER)
    traced.until(lambda: world.execution_reports(second))
    assert world.execution_report(first).outcome is Outcome.REPLACED
    assert world.execution_report(second).outcome is Outcome.REACHED
    traced.check_passed()
    assert [traced.visits(point) for point in VIA] == [1, 1]


def test_goals_that_stream_do_not_send_the_arm_back_to_points_that_it_has_passed(traced):
    world = traced.world
    goals = [(GOAL[0] - 0.002 * k, GOAL[1] + 0.002 * k) for k in range(12)]
    for x, z in goals:
        last, due = world.send_goal(x, z), world.now + 0.3
        traced.until(lambda due=due: world.now >= due)
    traced.until(lambda: world.execution_reports(last))
    assert world.execution_report(last).outcome is Outcome.REACHED
    assert len(world.sent) > 5
    traced.check_passed()
    assert [traced.visits(point) for point in VIA] == [1, 1]


def test_from_rest_and_under_other_parameters_all_points_lie_ahead_again(traced):
    world = traced.world
    first = world.send_goal(*GOAL)
    traced.until(lambda: world.execution_reports(first))
    traced.tips.clear()
    second = world.send_goal(0.45, -0.20)
    traced.until(lambda: world.execution_reports(second))
    traced.check_passed()

    traced.tips.clear()
    kind = world.planned[-1].settings.options.planner
    traced.set(planner=kind, via=VIA[:1], via_tolerance=TOLERANCE)
    third = world.send_goal(*GOAL)
    traced.until(lambda: traced.away(VIA[0]) < 0.01)
    traced.until(lambda: traced.away(VIA[0]) > 0.05)
    traced.set(planner=kind, via=VIA[:1], via_tolerance=0.9 * TOLERANCE)
    fourth = world.send_goal(*OTHER)
    traced.until(lambda: world.execution_reports(fourth))
    assert world.execution_reports(third)
    assert world.execution_report(fourth).outcome is Outcome.REACHED
    assert traced.visits(VIA[0]) == 2


def test_an_arm_that_is_at_the_goal_stays_there_whatever_lies_on_the_way(traced):
    world = traced.world
    first = world.send_goal(0.55, 0.10)
    traced.until(lambda: world.execution_reports(first))
    again = world.send_goal(0.55, 0.10)
    assert world.verdict(again).code is Verdict.AT_GOAL
    assert not world.arm.is_moving


def test_a_point_that_cannot_be_passed_has_the_goal_refused_and_is_named(traced):
    traced.set(via=((1.028, 0.0),), via_tolerance=TOLERANCE)
    verdict = traced.world.verdict(traced.world.send_goal(*GOAL))
    assert not verdict.code.accepted
    assert "(1.028, 0)" in verdict.sentence
    assert not traced.world.arm.is_moving
