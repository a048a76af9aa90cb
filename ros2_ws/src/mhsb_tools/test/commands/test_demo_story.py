"""The end of the demo says what became of each goal, and what it took."""

from pathlib import Path

import pytest

from mhsb_model.verdict import Verdict
from mhsb_planner.planners.registry import PLANNER_KINDS
from mhsb_tools.commands.demo_story import format_story
from mhsb_tools.comparison.supply_comparison import compare_on_tour


def goal(x, z, fate, code=Verdict.OK, rest=None):
    return {
        "x_m": x, "z_m": z, "code": code.value, "sentence": "a sentence",
        "fate": fate, "explanation": "a sentence", "distance_at_rest_mm": rest,
    }  # fmt: skip


SUMMARY = {
    "goals": [
        goal(0.55, 0.6, "replaced"),
        goal(0.55, -0.6, "reached", rest=0.031),
        goal(0.55, -0.6, "at_goal", Verdict.AT_GOAL),
        goal(9.0, 0.0, "refused", Verdict.OUT_OF_WORKSPACE),
        goal(None, 0.0, "refused", Verdict.NOT_FINITE),
        goal(0.55, 0.1, "lost"),
        goal(0.55, 0.2, "aborted"),
    ],
    "goals_sent": 7, "goals_accepted": 5, "switches_in_motion": 1,
    "goal_fates": {
        "replaced": 1, "reached": 1, "at_goal": 1, "refused": 2, "lost": 1,
        "aborted": 1,
    },
    "replan_ms": {"p50": 52.0}, "lead_ms": {"p50": 90.0}, "reference_jump_max_rad": 0.0,
    "tip_error_rms_mm": 0.26, "tip_error_max_mm": 2.5,
    "cavitation": [{"actuator": "actuator_1", "duration_s": 0.18, "force_n": 3500.0}],
    "energy_measured_j": {"mp": 900.0, "sp": 100.0},
}  # fmt: skip
TOUR = {
    "planned_j": {"table": 1500.0, "fixed": 1250.0, "integrated": 1000.0},
    "constant_pressure_j": 2000.0, "constant_pressure_pa": 8e6, "failures": {},
}  # fmt: skip


def test_goals_are_named_by_what_became_of_them():
    lines = format_story(SUMMARY, TOUR, Path("out"))
    fates = [line for line in lines if line.startswith("goal ")]
    assert len(fates) == 7
    assert fates[0].endswith("replaced in motion by the next goal")
    assert fates[1].endswith("reached; the tip rests 0.03 mm from it")
    assert fates[2].endswith("the tip was there already")
    assert fates[3].endswith(f"{Verdict.OUT_OF_WORKSPACE.value}: a sentence")
    assert "not a finite position" in fates[4]
    assert fates[5].endswith("lost: a sentence")
    assert fates[6].endswith("aborted: a sentence")
    assert (
        "7 goals sent, 5 accepted: 1 replaced in motion by the next goal, 1 reached, "
        "1 there already, 2 refused, 1 lost, 1 aborted"
    ) in lines
    assert "missed" not in "\n".join(lines)


def test_energies_are_compared_with_those_of_other_methods_on_the_same_goals():
    words = "\n".join(format_story(SUMMARY, TOUR, Path("out")))
    assert "oil in this run, simulated: 1000 J, 100 J of it by the servo pumps" in words
    for name, factor in (("planner of the paper", 1.5), ("conventional planner", 1.25)):
        (line,) = (line for line in words.splitlines() if name in line)
        assert line.endswith(f"{factor:.2f} times as much")
    assert "one constant pressure of 8.0 MPa" in words
    assert "2.00 times as much" in words
    assert "out/report" in words


@pytest.mark.parametrize("missing", ["replan_ms", "lead_ms"])
def test_what_a_recording_has_no_data_for_is_left_out(missing):
    bare = SUMMARY | {
        missing: {"p50": None}, "tip_error_rms_mm": None, "reference_jump_max_rad": None,
        "energy_measured_j": {"mp": None, "sp": None}, "cavitation": [],
    }  # fmt: skip
    tour = TOUR | {"constant_pressure_pa": None, "planned_j": {}}
    words = "\n".join(format_story(bare, tour, Path("out")))
    assert "None" not in words
    assert "energy" not in words


def test_a_tour_is_planned_from_goal_to_goal_by_every_planner(machine):
    goals = [(0.55, 0.60), (0.55, 0.60), (0.60, 0.10)]
    tour = compare_on_tour(machine, goals)
    assert tour["failures"] == {}
    assert set(tour["planned_j"]) == set(PLANNER_KINDS)
    assert 0.0 < tour["planned_j"]["integrated"] <= min(tour["planned_j"].values())
    assert tour["constant_pressure_pa"] > machine.arrays.supply_pressure
    assert tour["constant_pressure_j"] > tour["planned_j"]["integrated"]
    nowhere = compare_on_tour(machine, [*goals, (9.0, 0.0)])
    assert nowhere["planned_j"] == {}
    assert nowhere["constant_pressure_j"] is None
    assert all("outside the workspace" in each for each in nowhere["failures"].values())
