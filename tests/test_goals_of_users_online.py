"""Regions and points on the way, set as parameters of the planner, over real DDS."""

import re

import numpy as np

from mhsb_model.verdict import Outcome, Verdict
from mhsb_planner.motion.via_check import describe_first_missed

NEAR, OUTSIDE, BACK = (0.55, 0.20), (1.05, 0.10), (0.50, -0.05)
VIA = (0.62, 0.05, 0.55, -0.02)


def set_at_planner(arm, **values):
    for name, value in values.items():
        taken, reason = arm.set_parameter("mhsb_planner", name, value)
        assert taken, reason


def until_at_rest(arm):
    """The measured tip may be there while the last references are still on their way."""
    arm.until(lambda: not arm.references[-1].state.velocity.any())


def test_the_planner_logs_why_a_goal_is_refused(observer, nodes):
    planner = nodes("mhsb_sim", "mhsb_planner")["mhsb_planner"]
    observer.until(lambda: observer.is_matched)
    verdict = observer.request_verdict(*OUTSIDE)
    assert planner.wait_for("goal refused with OUT_OF_WORKSPACE: " + re.escape(verdict.sentence))


def test_a_region_is_reached_and_points_on_the_way_are_passed(arm):
    # A goal out of reach is answered by its region, and reached where the tip is in it.
    assert arm.request_verdict(*OUTSIDE).code is Verdict.OUT_OF_WORKSPACE
    set_at_planner(arm, goal_tolerance=0.03)
    verdict = arm.request_verdict(*NEAR)
    assert verdict.code is Verdict.OK, verdict.sentence
    assert verdict.goal.position == NEAR
    ending = arm.ending_of(verdict)
    assert ending.outcome is Outcome.REACHED
    assert "mm from the goal's region" in ending.sentence
    until_at_rest(arm)
    tip = arm.machine.tip_position(arm.references[-1].state.position)
    assert 1e-3 < np.hypot(*(tip - NEAR)) <= 0.03 + 1e-6

    # Inside it there is nothing to do.
    assert arm.request_verdict(*NEAR).code is Verdict.AT_GOAL
    set_at_planner(arm, goal_tolerance=0.0)

    # What can never be passed is not taken.
    taken, reason = arm.set_parameter("mhsb_planner", "goal_via", (0.6, 0.1, -0.3, 0.4))
    assert not taken
    assert "goal_via cannot be passed: the tip position (-0.3, 0.4) m is outside" in reason

    # Points are passed one after the other, without a stop.
    set_at_planner(arm, goal_via=VIA, goal_via_tolerance=0.012)
    arm.references.clear()
    verdict = arm.request_verdict(*BACK)
    assert verdict.code is Verdict.OK, verdict.sentence
    assert arm.ending_of(verdict).outcome is Outcome.REACHED
    until_at_rest(arm)
    tips = np.array([arm.machine.tip_position(each.state.position) for each in arm.references])
    passing = tuple((x, z, 0.0125) for x, z in np.reshape(VIA, (2, 2)).tolist())
    assert describe_first_missed(tips, passing) == ""
    assert np.hypot(*(tips[-1] - BACK)) < 1e-4
    assert arm.largest_reference_step() < 1e-3
