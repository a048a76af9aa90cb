"""The summary of a recording whose numbers are known."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from mhsb_model.trajectory import SECOND_NS
from mhsb_model.verdict import Outcome
from mhsb_tools.recording.bag_reader import read_recording
from mhsb_tools.report.goal_fates import GoalResult, judge_recorded_goals
from mhsb_tools.report.recorded_run import evaluate_recording
from mhsb_tools.report.summary import compute_speed_excess, compute_summary


@pytest.fixture(scope="module")
def numbers(run) -> dict:
    return compute_summary(run)


def test_goals_are_counted_by_what_became_of_them(numbers):
    assert numbers["goals_sent"] == 6
    assert numbers["goals_accepted"] == 4
    assert numbers["goals_reached"] == 2
    assert numbers["switches_in_motion"] == 1


def test_a_place_counts_as_reached_whichever_of_its_goals_led_there(run, numbers):
    assert numbers["places_not_reached"] == 3  # replaced, out of the workspace, not a number
    first, *others = run.goals
    again = replace(first, outcome=Outcome.REACHED)
    assert compute_summary(replace(run, goals=(first, *others, again)))["places_not_reached"] == 2


def test_goals_are_lost_or_superseded_as_their_fates_tell(run, numbers):
    assert (numbers["goals_superseded"], numbers["goals_lost"]) == (0, 0)
    recording = replace(run.recording, plans_in_force=run.recording.plans_in_force[:-2])
    without_the_last = compute_summary(replace(run, judged_goals=judge_recorded_goals(recording)))
    assert without_the_last["goals_lost"] == 1
    assert "no plan for it came into force" in without_the_last["lost"][0]["reason"]


def test_the_fates_of_all_goals_sum_to_the_goals_that_were_sent(run, numbers):
    assert numbers["goal_fates"] == {
        "replaced": 1, "reached": 2, "refused": 2, "at_goal": 1,
    }  # fmt: skip
    first, *others = run.judged_goals
    lost = replace(first, result=GoalResult.LOST, reason="there was time")
    told = compute_summary(replace(run, judged_goals=(lost, *others)))
    assert sum(told["goal_fates"].values()) == told["goals_sent"]
    assert (told["goals_lost"], told["goals_replaced"]) == (1, 0)
    assert told["goals"][0]["fate"] == "lost"
    assert told["goals"][0]["explanation"] == "there was time"


def test_goals_whose_messages_were_not_recorded_count_and_are_mentioned(run, numbers, caplog):
    recording = replace(run.recording, goals=run.recording.goals[3:])
    found = compute_summary(evaluate_recording(recording, run.machine))
    assert found == {**numbers, "goals_not_recorded": 3}
    assert "goals that are not in the recording: 3" in caplog.text


def test_the_lead_is_that_of_plans_that_were_applied(run, numbers):
    assert numbers["lead_ms"] == {"p50": None, "p99": None, "max": None}  # nobody told
    told = [
        each if lead is None else replace(each, execution=replace(each.execution, lead_ms=lead))
        for each, lead in zip(run.judged_goals, (60.0, 80.0, None, None, 70.0, None), strict=True)
    ]
    assert compute_summary(replace(run, judged_goals=told))["lead_ms"]["p50"] == 70.0


def test_the_root_mean_square_of_a_sinus_is_that_of_its_amplitude(numbers, story):
    # It swings in 8 of the 9 s from the first to the last motion.
    expected = 1e3 * story.tip_swing * np.sqrt(8 / 9 / 2)
    assert numbers["tip_error_rms_mm"] == pytest.approx(expected, rel=2e-3)
    assert numbers["tip_error_max_mm"] == pytest.approx(1e3 * story.tip_swing, rel=2e-3)


def test_the_error_at_rest_is_the_largest_of_the_goals_that_were_reached(numbers):
    assert numbers["tip_error_rest_max_mm"] == pytest.approx(5.0, abs=1e-6)
    at_rest = [goal["distance_at_rest_mm"] for goal in numbers["goals"]]
    assert at_rest == [None, pytest.approx(2.0), None, None, pytest.approx(5.0), None]


def test_jumps_are_those_of_applied_plans(numbers):
    assert numbers["reference_jump_max_rad"] == 2e-7
    assert numbers["reference_jump_max_rad_s"] == 4e-7
    assert (numbers["plans_applied"], numbers["plans_refused"]) == (3, 2)


def test_a_plan_refused_twice_counts_once(run):
    told = run.recording.hand_overs
    twice = replace(run, recording=replace(run.recording, hand_overs=(*told, told[-1])))
    assert compute_summary(twice)["plans_refused"] == 2


def test_planned_energy_is_that_of_strokes_leakage_and_the_boosted_hold(numbers, story):
    assert numbers["energy_planned_j"] == pytest.approx(story.energy(series=False), rel=1e-4)
    assert numbers["energy_planned_series_j"] == pytest.approx(story.energy(series=True), rel=1e-4)
    assert story.energy(series=False) > story.energy(series=True)


def test_measured_energy_spans_the_same_time(numbers):
    assert numbers["energy_measured_j"] == {"mp": 110.0, "sp": 22.0}
    assert numbers["energy_span_s"] == 11.0


def test_modes_are_counted_where_they_change(numbers):
    assert numbers["mode_switches"] == 1
    assert numbers["modes_used"] == ["N", "DB"]


def test_pressures_are_the_highest_of_all_actuators(numbers):
    assert numbers["max_supply_pressure_mpa"] == pytest.approx(9.25)
    assert numbers["max_chamber_pressure_mpa"] == pytest.approx(7.5)
    assert numbers["relief_exceeded"] is False


@pytest.mark.parametrize("quantity", ["supply_pressure", "rod_pressure"])
def test_a_pressure_beyond_relief_is_told(run, quantity):
    actuators = run.recording.actuators
    table = {**actuators.quantity, quantity: actuators.quantity[quantity] + 30e6}
    recording = replace(run.recording, actuators=replace(actuators, quantity=table))
    assert compute_summary(replace(run, recording=recording))["relief_exceeded"] is True


def test_replanning_times_leave_out_goals_that_needed_no_plan(numbers):
    assert numbers["replan_ms"] == {"p50": 20.0, "p99": pytest.approx(29.8), "max": 30.0}


def test_times_are_those_of_the_simulator(numbers):
    assert numbers["duration_s"] == pytest.approx(12.0)
    assert numbers["real_time_factor"] == pytest.approx(2.0)


def test_each_goal_is_told(numbers):
    codes = [goal["code"] for goal in numbers["goals"]]
    assert codes == ["OK", "OK", "OUT_OF_WORKSPACE", "NOT_FINITE", "OK", "AT_GOAL"]
    outcomes = [goal["outcome"] for goal in numbers["goals"]]
    assert outcomes == ["replaced", "reached", None, None, "reached", None]
    assert [goal["in_motion"] for goal in numbers["goals"]] == [False, True] + 4 * [False]
    assert numbers["goals"][2]["x_m"] == 2.0
    assert numbers["goals"][2]["plan_ms"] is None


def test_what_is_not_a_number_is_null(numbers):
    text = json.dumps(numbers, allow_nan=False)
    assert json.loads(text)["goals"][3]["x_m"] is None


def test_without_plans_and_reports_the_numbers_are_null(idle_bag, machine):
    numbers = compute_summary(evaluate_recording(read_recording(idle_bag), machine))
    json.dumps(numbers, allow_nan=False)
    assert numbers["goals_sent"] == numbers["goals_accepted"] == 0
    for key in ("tip_error_rest_max_mm", "energy_planned_j", "real_time_factor"):
        assert numbers[key] is None
    assert numbers["energy_measured_j"] == {"mp": None, "sp": None}
    assert numbers["replan_ms"] == {"p50": None, "p99": None, "max": None}


def test_cavitation_is_told_of_forces_that_pull_moving_pistons(run, numbers):
    assert numbers["cavitation"] == []
    assert numbers["min_chamber_pressure_mpa"] == pytest.approx(0.5)
    actuators = run.recording.actuators
    force, speed = np.zeros((2, len(actuators.time_ns), 3))
    force[100:151, 1], speed[100:140, 1] = -2000.0, 0.01  # pulled out, then held
    quantity = {**actuators.quantity, "force": force, "piston_speed": speed}
    recording = replace(run.recording, actuators=replace(actuators, quantity=quantity))
    (found,) = compute_summary(replace(run, recording=recording))["cavitation"]
    assert found["actuator"] == "actuator_2"
    assert found["begin_s"] == pytest.approx(1.0)
    assert found["duration_s"] == pytest.approx(0.4)
    assert found["force_n"] == -2000.0


def test_numbers_that_json_does_not_have_are_null(run):
    infinite = np.full_like(run.energy.main_pump, np.inf)
    content = compute_summary(replace(run, energy=replace(run.energy, main_pump=infinite)))
    assert json.loads(json.dumps(content, allow_nan=False)) == content
    assert content["energy_measured_j"]["mp"] is None


def test_the_v_max_with_which_speeds_are_compared_is_that_of_the_machine_file(numbers):
    assert numbers["v_max_of_file_mm_s"] == pytest.approx(3 * [12.0])  # paper: Table 2


def test_the_measured_excess_over_v_max_is_that_of_a_motion_of_known_speed(run):
    """Joint 2 turns so fast that its piston goes 1.3 times V_max, beside a vibration of 500 Hz."""
    machine, time_ns = run.machine, np.arange(0, SECOND_NS, SECOND_NS // 100)
    posture = np.asarray(machine.config.simulation.start_posture)
    speed = 1.3 * machine.arrays.max_piston_speed[1] / abs(machine.moment_arms(posture)[1])
    position = np.tile(posture, (len(time_ns), 1))
    position[:, 1] += 0.1 * speed * (time_ns / SECOND_NS - 0.5)
    position[40:60, 1] = position[40, 1] + speed * (time_ns[40:60] - time_ns[40]) / SECOND_NS
    position[60:, 1] = position[59, 1]
    position += 2e-5 * (-1.0) ** np.arange(len(time_ns))[:, None]
    joints = replace(
        run.recording.joint_states, time_ns=time_ns, position=position, velocity=0 * position
    )
    moved = replace(run, recording=replace(run.recording, joint_states=joints))
    assert compute_speed_excess(moved) == pytest.approx(0.3, abs=0.03)
    still = replace(joints, position=0 * position + posture)
    assert compute_speed_excess(
        replace(run, recording=replace(run.recording, joint_states=still))
    ) == pytest.approx(-1.0)
