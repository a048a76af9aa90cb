"""Goals sent to both nodes over real DDS: accepted, refused, replaced, reached."""

import math
import time

import numpy as np
import pytest
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from std_msgs.msg import Header

from mhsb_model.verdict import Outcome, Verdict
from mhsb_msgs_py import stamps

UP, DOWN, OUT = (0.55, 0.60), (0.55, -0.60), (0.75, 0.55)


def goal_message(stamp_ns, frame="base_link", point=(0.6, 0.0, 0.1), w=1.0) -> PoseStamped:
    x, y, z = point
    pose = Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(w=w))
    return PoseStamped(header=Header(stamp=stamps.to_time(stamp_ns), frame_id=frame), pose=pose)


def test_goals_are_replanned_in_motion_and_the_last_one_is_reached(arm):
    arm.references.clear()
    verdicts = []
    for goal in (UP, DOWN, OUT, (0.6, 0.1)):
        verdicts.append(arm.request_verdict(*goal))
        assert verdicts[-1].code is Verdict.OK, verdicts[-1].sentence
        arm.until_in_force(verdicts[-1])
        arm.serve(1.0)
    endings = [arm.ending_of(verdict) for verdict in verdicts]
    assert [ending.outcome for ending in endings] == [
        Outcome.REPLACED,
        Outcome.REPLACED,
        Outcome.REPLACED,
        Outcome.REACHED,
    ]
    arm.until(lambda: not arm.references[-1].state.velocity.any())  # the report may come first
    assert np.hypot(*(arm.machine.tip_position(arm.references[-1].state.position) - (0.6, 0.1))) < (
        1e-4
    )
    applied = [report for report in arm.hand_overs if report.outcome == "applied"]
    assert len(applied) == 4
    assert max(report.position_jump for report in applied) <= 1e-6
    assert max(report.velocity_jump for report in applied) <= 1e-6
    assert arm.largest_reference_step() < 1e-3


def test_simulated_time_is_the_systems_so_that_plans_come_neither_early_nor_late(arm):
    def age_ns() -> int:
        return time.time_ns() - arm.references[-1].stamp_ns

    arm.references.clear()
    arm.until(lambda: len(arm.references) > 20)
    arm.until(lambda: age_ns() < 500_000_000)
    assert age_ns() >= 0


def test_refused_goals_leave_the_motion_as_it_is(arm):
    under_way = arm.request_verdict(*UP)
    arm.until_in_force(under_way)
    in_force_ns = arm.in_force_ns
    refusals = {
        Verdict.OUT_OF_WORKSPACE: goal_message(11, point=(2.0, 0.0, 0.0)),
        Verdict.NOT_FINITE: goal_message(12, point=(math.nan, 0.0, 0.3)),
        Verdict.FRAME: goal_message(13, frame="map"),
        Verdict.INFEASIBLE: goal_message(14, point=(0.0, 0.0, 0.3)),
    }
    for code, message in refusals.items():
        verdict = arm.ask_message(message)
        assert verdict.code is code
        assert len(verdict.sentence) > 20
    assert arm.ask_message(goal_message(15, w=math.nan)).code is Verdict.NOT_FINITE
    assert arm.ask_message(goal_message(16, point=(0.6, 0.5, 0.1))).code is Verdict.OUT_OF_WORKSPACE
    assert arm.in_force_ns == in_force_ns
    assert arm.ending_of(under_way).outcome is Outcome.REACHED


def test_a_goal_on_the_work_plane_is_the_same_goal_laid_flat(arm):
    verdict = arm.ask_message(goal_message(21, frame="work_plane", point=(0.6, 0.1, 0.0)))
    assert verdict.code is Verdict.OK
    assert verdict.goal.position == (0.6, 0.1)
    arm.ending_of(verdict)
    arm.until(lambda: arm.in_force_ns == 0 and not arm.references[-1].state.velocity.any())
    again = arm.request_verdict(0.6, 0.1)
    assert again.code is Verdict.AT_GOAL
    assert again.plan.energy_j == 0.0


def test_of_a_flood_of_goals_each_gets_one_verdict_and_the_newest_wins(arm):
    goals = [(0.6, 0.1 + 0.01 * k) for k in range(30)]
    sent = []
    for goal in goals:
        sent.append(arm.send(*goal))
        arm.serve(0.002)
    arm.until(lambda: sent[-1] in arm.verdicts)
    codes = [arm.verdicts[stamp].code for stamp in sent if stamp in arm.verdicts]
    assert codes[-1] is Verdict.OK
    assert set(codes) <= {Verdict.OK, Verdict.SUPERSEDED}
    assert Verdict.SUPERSEDED in codes
    arm.until_in_force(arm.verdicts[sent[-1]])


def test_goals_that_stream_are_each_answered_once_and_the_arm_rests_at_the_last(arm):
    sent = []
    for k in range(100):
        sent.append(arm.send(0.6, 0.1 + 0.001 * k))
        arm.serve(0.02)
    arm.until(lambda: sent[-1] in arm.executions, 40.0)
    codes = [arm.verdicts[stamp].code for stamp in sent]
    assert set(codes) <= {Verdict.OK, Verdict.SUPERSEDED}
    assert codes[-1] is Verdict.OK
    assert codes.count(Verdict.OK) > 5
    assert arm.executions[sent[-1]].outcome is Outcome.REACHED
    arm.until(lambda: not arm.references[-1].state.velocity.any())
    assert arm.largest_reference_step() < 1e-3
    tip = arm.machine.tip_position(arm.references[-1].state.position)
    assert np.hypot(*(tip - (0.6, 0.199))) < 1e-3


@pytest.mark.parametrize("node", ["mhsb_planner", "mhsb_sim"])
def test_stopping_decelerates_and_holds_and_the_next_goal_goes_on_from_there(arm, node):
    verdict = arm.request_verdict(*UP)
    arm.until_in_force(verdict)
    arm.serve(1.5)
    arm.references.clear()
    assert arm.call(f"{node}/stop").success
    arm.until(lambda: arm.references and not arm.references[-1].state.velocity.any())
    assert arm.ending_of(verdict).outcome is Outcome.STOPPED
    assert arm.largest_reference_step() < 1e-3
    later = arm.request_verdict(*DOWN)
    assert later.code is Verdict.OK, later.sentence
    arm.until_in_force(later)


@pytest.mark.parametrize("node", ["mhsb_planner", "mhsb_sim"])
def test_a_stop_while_a_plan_is_made_ends_its_goal_at_rest_and_in_motion(arm, node):
    for x, z in (UP, DOWN, UP):
        if (x, z) == DOWN:  # in motion
            arm.until_in_force(arm.request_verdict(*UP))
        stamp_ns = arm.send(x, z)
        arm.serve(0.01)
        assert arm.call(f"{node}/stop").success
        arm.until(lambda stamp_ns=stamp_ns: stamp_ns in arm.verdicts)
        verdict = arm.verdicts[stamp_ns]
        assert verdict.code in (Verdict.OK, Verdict.STOPPED), verdict.sentence
        if verdict.code is Verdict.OK:
            assert arm.ending_of(verdict).outcome is Outcome.STOPPED
        arm.serve(1.5)
        arm.references.clear()
        arm.serve(0.5)
        assert not any(each.state.velocity.any() for each in arm.references)


def test_parameters_apply_to_the_next_plan_and_are_refused_out_of_range(arm):
    before = arm.request_verdict(*UP)
    taken, reason = arm.set_parameter("mhsb_planner", "payload", -1.0)
    assert not taken
    assert "payload" in reason
    taken, _ = arm.set_parameter("mhsb_planner", "payload", 0.0)
    assert taken
    lighter = arm.request_verdict(*UP)
    assert lighter.code is Verdict.OK, lighter.sentence
    assert lighter.plan.energy_j < before.plan.energy_j
    taken, reason = arm.set_parameter("mhsb_sim", "real_time_factor", 2.0)
    assert not taken
    assert "publish_clock" in reason


def test_two_planners_of_one_name_are_noticed_by_both(ros_domain, start_planner):
    children = [start_planner(), start_planner()]
    for child in children:
        child.wait_for("there are 2 nodes called /mhsb_planner")
