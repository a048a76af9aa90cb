"""The simulator supervised over real DDS: what a fault stops, what is told, what clears it."""

from __future__ import annotations

import signal

import numpy as np
import pytest

from mhsb_model.verdict import Outcome, Verdict

UP = (0.55, 0.60)
MOVE = np.array([0.3, 0.3, 0.4])


def latest(observer):
    return observer.simulator_reports[-1]


def until_faulty(observer, timeout=15.0):
    observer.until(lambda: observer.simulator_reports and latest(observer).faulty, timeout)
    return latest(observer).sentence


def until_held(observer, timeout=40.0):
    observer.until(lambda: "its reference is where it stands" in latest(observer).sentence, timeout)


def until_sound(observer, timeout=15.0):
    observer.until(lambda: not latest(observer).faulty, timeout)


def fastest_joint(observer, duration):
    """Highest measured joint speed [rad/s] for a while."""
    observer.measured.clear()
    observer.serve(duration)
    return max(float(np.abs(each.velocity).max()) for each in observer.measured)


def check_that_it_goes_on(observer, commander, by=MOVE):
    """From where the arm stands, with the next plan."""
    reference, measured = observer.references[-1], observer.measured[-1]
    np.testing.assert_allclose(reference.state.position, measured.position, atol=2e-3)
    commander.apply(commander.move(by))
    observer.references.clear()
    observer.until(lambda: observer.in_force_ns == 0, 20.0)
    assert observer.largest_reference_step() < 1e-3
    assert not latest(observer).faulty


def test_a_main_pump_that_fails_in_motion_stops_the_arm_and_healing_moves_nothing(
    observer, commander
):
    commander.apply(commander.move(MOVE))
    observer.serve(2.0)
    assert not latest(observer).faulty
    assert observer.set_parameter("mhsb_sim", "fault", "main_pump")[0]
    observer.references.clear()
    sentence = until_faulty(observer, 1.0)
    assert "of the main pump's pressure, at most 0.8 is allowed" in sentence
    assert "call ~/clear_faults" in sentence
    observer.until(lambda: observer.in_force_ns == 0, 0.5)
    until_held(observer)
    assert not observer.references[-1].state.velocity.any()

    refused = commander.outcome_of(commander.move(MOVE))
    assert (refused.outcome, refused.reason) == ("refused", "fault")
    assert sentence.partition(":")[0] in refused.sentence

    assert observer.set_parameter("mhsb_sim", "fault", "none")[0]
    assert fastest_joint(observer, 1.0) < 0.05
    assert latest(observer).faulty
    response = observer.call("mhsb_sim/clear_faults")
    assert response.success, response.message
    assert fastest_joint(observer, 2.0) < 0.05
    assert not latest(observer).faulty
    check_that_it_goes_on(observer, commander, -MOVE / 2)


def test_a_main_pump_that_fails_at_rest_is_noticed_and_cleared_with_one_call(observer, commander):
    observer.serve(0.5)
    assert observer.set_parameter("mhsb_sim", "fault", "main_pump")[0]
    until_faulty(observer, 2.0)
    response = observer.call("mhsb_sim/clear_faults")
    assert response.message.startswith("the fault main_pump is healed; the fault is cleared as")
    until_sound(observer)
    check_that_it_goes_on(observer, commander)


def test_servo_pumps_that_fail_stop_an_arm_that_cannot_follow(observer, commander):
    """Stretched out, J1 needs more than the main pump gives."""
    assert observer.set_parameter("mhsb_sim", "fault", "servo_pumps")[0]
    applied = commander.outcome_of(commander.move(np.array([0.1, 1.1, 1.4]), duration=14.0))
    assert applied.outcome == "applied"
    until_faulty(observer)
    until_held(observer)
    assert observer.call("mhsb_sim/clear_faults").success
    until_sound(observer)
    assert fastest_joint(observer, 1.0) < 0.05


@pytest.mark.slow
def test_two_tonnes_at_rest_are_told_at_once_and_taken_off_gently(observer, commander):
    observer.serve(0.5)
    assert observer.set_parameter("mhsb_sim", "payload", 2000.0)[0]
    sentence = until_faulty(observer, 1.0)
    assert "off its reference, at most 0.06 rad is allowed" in sentence
    until_held(observer)
    assert observer.set_parameter("mhsb_sim", "payload", 10.0)[0]
    observer.measured.clear()
    assert observer.call("mhsb_sim/clear_faults").success
    until_sound(observer, 30.0)
    observer.serve(1.0)
    assert max(float(np.abs(each.velocity).max()) for each in observer.measured) < 0.05
    check_that_it_goes_on(observer, commander, np.array([0.3, -0.3, -0.3]))


def test_warnings_come_before_the_arm_is_stopped_and_pass(observer, commander):
    for name, value in (("following_error_warning", 0.015), ("following_error_limit", 1.0)):
        taken, reason = observer.set_parameter("mhsb_sim", name, value)
        assert taken, reason
    assert observer.set_parameter("mhsb_sim", "payload", 40.0)[0]
    text = "off its reference, beyond 1 rad the arm is stopped"
    observer.until(lambda: observer.simulator_reports and text in latest(observer).sentence)
    assert latest(observer).warning
    assert not latest(observer).faulty
    assert observer.set_parameter("mhsb_sim", "payload", 10.0)[0]
    observer.until(lambda: text not in latest(observer).sentence)


def test_limits_out_of_range_or_order_are_refused_with_the_reason(observer, simulator):
    taken, reason = observer.set_parameter("mhsb_sim", "following_error_warning", 0.5)
    assert not taken
    assert reason == (
        "following_error_warning 0.5 is beyond following_error_limit 0.06; a warning comes first"
    )
    assert not observer.set_parameter("mhsb_sim", "saturation_limit", -1.0)[0]


def test_an_arm_that_starts_with_two_tonnes_says_so_and_is_sound_after_a_reset(
    observer, start_simulator
):
    start_simulator("--ros-args", "-p", "payload:=2000.0")
    assert "of its relief valve's setting, at most 0.97 is allowed" in until_faulty(observer)
    assert observer.call("mhsb_sim/stop").success
    assert observer.set_parameter("mhsb_sim", "payload", 10.0)[0]
    assert observer.call("mhsb_sim/reset").success
    until_sound(observer)
    assert fastest_joint(observer, 1.0) < 0.05


def test_when_the_planner_is_gone_the_plan_is_finished_and_its_end_held(
    observer, simulator, start_planner
):
    planner = start_planner()
    observer.until(lambda: observer.is_matched and len(observer.references) > 0)
    verdict = observer.request_verdict(0.50, 0.10)
    assert verdict.code is Verdict.OK, verdict.sentence
    observer.until_in_force(verdict)
    planner.process.kill()
    planner.wait()
    observer.until(lambda: observer.in_force_ns == 0, verdict.plan.duration_s + 5.0)
    observer.serve(0.3)
    end = observer.references[-1].state
    assert not end.velocity.any()
    assert np.hypot(*(observer.machine.tip_position(end.position) - (0.50, 0.10))) < 1e-4


@pytest.mark.parametrize("service", ["clear_faults", "reset"])
def test_a_sensor_that_tells_no_number_stops_the_arm_by_name_until_it_is_cleared(arm, service):
    verdict = arm.request_verdict(*UP)
    arm.until_in_force(verdict)
    taken, reason = arm.set_parameter("mhsb_sim", "fault", "sensor_dead:actuator_1.line_pressure")
    assert taken, reason
    arm.until(lambda: arm.simulator_reports and arm.simulator_reports[-1].faulty)
    named = "the line pressure sensor of actuator_1 has given no reading"
    assert named in arm.simulator_reports[-1].sentence
    arm.until(lambda: arm.in_force_ns == 0)
    assert arm.ending_of(verdict).outcome in (Outcome.ABORTED, Outcome.STOPPED)
    arm.until(lambda: "its reference is where it stands" in arm.simulator_reports[-1].sentence)
    told = len(arm.references)
    arm.until(lambda: len(arm.references) > told + 2)  # the first ones may have been underway
    heard = len(arm.references)
    assert all(np.isfinite(each.state.position).all() for each in arm.references)
    stood = arm.references[-1].state.position
    assert arm.call(f"mhsb_sim/{service}").success
    arm.until(lambda: len(arm.references) > heard + 10)
    arm.until(lambda: not arm.simulator_reports[-1].faulty)
    if service == "clear_faults":
        np.testing.assert_allclose(arm.references[-1].state.position, stood, atol=0.01)
        assert fastest_joint(arm, 0.5) < 0.05
    later = arm.request_verdict(*UP)
    assert later.code is Verdict.OK, later.sentence
    arm.until_in_force(later)


def test_an_unknown_fault_is_refused_with_the_valid_ones(observer, simulator):
    taken, reason = observer.set_parameter("mhsb_sim", "fault", "gremlins")
    assert not taken
    assert "there is no fault 'gremlins'; valid are none, main_pump, " in reason


def test_a_dead_servo_pump_is_told_and_planned_without_until_it_is_cleared(arm):
    fault = "servo_pump_dead:1, servo_pump_dead:4"
    assert arm.set_parameter("mhsb_sim", "fault", fault)[0]
    assert arm.set_parameter("mhsb_planner", "payload", 16.0)[0]  # lifted in SB, if there is any
    verdict = arm.request_verdict(*UP)
    arm.until_in_force(verdict)
    arm.until(lambda: arm.simulator_reports and arm.simulator_reports[-1].lost_servo_pumps)
    assert "stands still" in arm.simulator_reports[-1].sentence
    lost = arm.simulator_reports[-1].lost_servo_pumps
    assert set(lost) <= {1, 4}


def test_a_simulator_that_is_killed_leaves_no_trace_on_the_next(observer, start_simulator):
    first = start_simulator()
    observer.until(lambda: len(observer.references) > 5)
    first.process.send_signal(signal.SIGKILL)
    first.wait()
    start_simulator()
    observer.references.clear()
    observer.until(lambda: len(observer.references) > 5)
    observer.simulator_reports.clear()
    observer.until(lambda: observer.simulator_reports)
    assert not latest(observer).faulty
