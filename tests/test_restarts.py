"""Nodes that die, freeze and come back: the next goal works, and the reference does not jump."""

import signal
import time

import pytest

from mhsb_model.verdict import Outcome, Verdict
from mhsb_msgs_py import topics

UP, DOWN, MIDDLE = (0.55, 0.60), (0.55, -0.60), (0.6, 0.1)


@pytest.fixture
def pair(observer, start_planner, start_simulator):
    children = {"simulator": start_simulator(), "planner": start_planner()}
    observer.until(lambda: observer.is_matched and len(observer.references) > 0)
    return children


def test_a_planner_alone_says_that_it_knows_no_arm(observer, start_planner):
    start_planner()
    observer.until(lambda: observer.is_matched)
    verdict = observer.request_verdict(*UP)
    assert verdict.code is Verdict.NO_STATE
    assert "start the arm" in verdict.sentence


@pytest.mark.parametrize(
    "how", [pytest.param(signal.SIGTERM, marks=pytest.mark.slow), signal.SIGKILL]
)
def test_a_planner_restarted_under_a_moving_arm_plans_without_a_jump(
    observer, start_planner, start_simulator, how
):
    start_simulator()
    # So slow that the arm still moves when the next planner is ready.
    planner = start_planner("--ros-args", "-p", "v_max:=0.002")
    observer.until(lambda: observer.is_matched and len(observer.references) > 0)
    first = observer.request_verdict(*UP)
    observer.until_in_force(first)
    observer.serve(1.0)
    before = observer.listeners_to_goals()
    assert planner.stop(how) == (0 if how == signal.SIGTERM else -signal.SIGKILL)
    start_planner()
    observer.until(lambda: observer.is_matched and bool(observer.listeners_to_goals() - before))
    assert observer.references[-1].state.velocity.any()
    observer.references.clear()
    verdict = observer.request_verdict(*DOWN)
    assert verdict.code is Verdict.OK, verdict.sentence
    observer.until(lambda: observer.references[-1].state.velocity.any())
    assert observer.ending_of(verdict, 90.0).outcome is Outcome.REACHED
    assert observer.largest_reference_step() < 1e-3
    applied = [each for each in observer.hand_overs if each.outcome == "applied"]
    assert max(each.position_jump for each in applied) <= 1e-6


def test_a_simulator_killed_and_restarted_under_a_running_planner_is_planned_for_anew(
    observer, pair, start_simulator
):
    first = observer.request_verdict(*UP)
    observer.until_in_force(first)
    observer.serve(1.0)
    pair["simulator"].stop(signal.SIGKILL)
    start_simulator()
    observer.references.clear()
    observer.until(lambda: len(observer.references) > 5 and observer.in_force_ns == 0)
    assert observer.ending_of(first).outcome is Outcome.ABORTED
    verdict = observer.request_verdict(*DOWN)
    assert verdict.code is Verdict.OK, verdict.sentence
    assert observer.ending_of(verdict, 90.0).outcome is Outcome.REACHED
    assert observer.largest_reference_step() < 1e-3


@pytest.mark.parametrize("frozen", ["simulator", "planner"])
def test_a_node_that_was_frozen_goes_on(observer, pair, frozen):
    first = observer.request_verdict(*UP)
    observer.until_in_force(first)
    observer.serve(0.5)
    in_force_ns = observer.in_force_ns
    pair[frozen].process.send_signal(signal.SIGSTOP)
    time.sleep(1.5)
    pair[frozen].process.send_signal(signal.SIGCONT)
    observer.serve(0.5)
    assert observer.in_force_ns == in_force_ns
    verdict = observer.request_verdict(*DOWN)
    assert verdict.code is Verdict.OK, verdict.sentence
    observer.until_in_force(verdict)
    assert observer.hand_overs[-1].position_jump <= 1e-6


def test_the_path_of_a_plan_is_shown_when_the_arm_follows_it(observer, pair):
    paths, shown = [], topics.PLANNED_PATH
    observer.create_subscription(shown.message, shown.name, paths.append, shown.qos)
    for first, goal in ((MIDDLE, UP), (DOWN, UP), (MIDDLE, DOWN)):
        # The planner knows all of the arm once a plan is in force, and its view has come.
        observer.until_in_force(observer.request_verdict(*first))
        observer.until(lambda: bool(paths))
        paths.clear()
        pair["simulator"].process.send_signal(signal.SIGSTOP)
        verdict = observer.request_verdict(*goal)
        observer.serve(0.5)
        shown_early = list(paths)
        pair["simulator"].process.send_signal(signal.SIGCONT)
        # On a busy computer, the frozen arm's state may be too old before planning begins.
        if verdict.code is not Verdict.NO_STATE:
            break
    assert verdict.code is Verdict.OK, verdict.sentence
    assert not shown_early
    observer.until(lambda: bool(paths))
    observer.until_in_force(verdict)


def test_simulated_time_can_run_faster_and_planning_follows_it(
    observer, start_planner, start_simulator
):
    start_simulator("--ros-args", "-p", "publish_clock:=true", "-p", "real_time_factor:=3.0")
    start_planner("--ros-args", "-p", "use_sim_time:=true")
    observer.until(lambda: observer.is_matched and len(observer.references) > 0)
    began = time.monotonic()
    verdict = observer.request_verdict(0.6, 0.1)
    assert verdict.code is Verdict.OK, verdict.sentence
    assert verdict.plan.plan_stamp_ns < 600 * 10**9
    assert observer.ending_of(verdict).outcome is Outcome.REACHED
    assert time.monotonic() - began < verdict.plan.duration_s + 1.0
