"""What `plan` is asked for: options that change nothing are refused, what a case loses is told."""

import re
from dataclasses import replace

import pytest

from mhsb_model.command_line import UsageError
from mhsb_model.errors import ArgumentError
from mhsb_planner.cases.paper_cases import load_paper_cases
from mhsb_planner.planner import PLANNER_KINDS, PlanOptions
from mhsb_planner.search.s2_search import Weights
from mhsb_tools.commands.plan_arguments import (
    build_request,
    check_options_have_effect,
    format_case_line,
    format_case_title,
    list_replaced_values,
)

THERE = ((0.55, -0.05), (0.55, 0.6), None)


@pytest.mark.parametrize(
    ("planner", "given", "sentence"),
    [
        (
            "table",
            {"initial_j3": 0.3},
            "--initial-j3 0.3 has no effect: the table planner takes the postures of the posture "
            "table; leave it out, or give --planner fixed",
        ),
        ("integrated", {"initial_j3": 0.3}, "leave it out, or give --planner fixed"),
        (
            "integrated",
            {"search": "published"},
            "--search published has no effect: the integrated planner searches in a way of its "
            "own; leave it out, or give --planner table or fixed",
        ),
        ("integrated", {"search": "exact"}, "--search exact has no effect"),
        ("integrated", {"heuristic_scale": 2.0}, "--heuristic-scale 2 has no effect"),
        ("table", {"heuristic_scale": 2.0}, "no such scale; leave it out, or give --search publ"),
        (
            "table",
            {"max_speed_excess": 0.2, "trajectory": "followed"},
            "a motion that follows its path keeps V_max",
        ),
        ("integrated", {"max_speed_excess": 0.2}, "or give --trajectory polynomial"),
        ("table", {"via_tolerance": 0.02}, "there is no point on the way"),
        ("fixed", {"area_weight": 5.0}, "or give --planner integrated"),
    ],
)
def test_an_option_that_changes_nothing_is_refused_with_the_reason(planner, given, sentence):
    with pytest.raises(UsageError, match=re.escape(sentence)):
        check_options_have_effect(build_request(*THERE, planner=planner), given)


@pytest.mark.parametrize(
    ("planner", "given"),
    [
        ("fixed", {"initial_j3": 0.3, "search": "published", "heuristic_scale": 2.0}),
        ("table", {"search": "exact", "max_speed_excess": 0.2, "energy_reading": "series"}),
        ("integrated", {"area_weight": 5.0, "trajectory": "polynomial", "max_speed_excess": 0.2}),
        ("table", {"via_tolerance": 0.02, "via": ((0.6, 0.1),), "area_weight": 0.0}),
    ],
)
def test_options_that_change_something_are_taken(planner, given):
    check_options_have_effect(build_request(*THERE, planner=planner), given)


def test_how_energy_is_read_is_refused_where_energy_has_no_weight():
    asked = build_request(*THERE, weights=(0.0, 15.0, 2.0))
    with pytest.raises(UsageError, match="series has no effect: energy has no weight"):
        check_options_have_effect(asked, {"energy_reading": "series"})


@pytest.mark.parametrize("planner", PLANNER_KINDS)
def test_with_nothing_left_to_choose_every_planner_is_taken(planner):
    check_options_have_effect(build_request(*THERE, planner=planner), {})


def test_what_is_given_in_place_of_what_a_case_says_is_told():
    asked = build_request(None, (0.6, 0.1), "1-1", (0.0, 15.0, 2.0), "integrated")
    case = load_paper_cases()["1-1"]
    assert list_replaced_values(asked) == [
        f"--goal 0.6 0.1 in place of its {case.goal[0]:g} {case.goal[1]:g}",
        "--weights 0 15 2 in place of its 0.5 0 2",
        "--planner integrated in place of its table",
    ]
    assert format_case_line(asked)[0].startswith("Case 1-1, but with --goal 0.6 0.1 in place of")
    assert format_case_title(asked) == "Case 1-1, changed: "
    assert format_case_title(build_request(None, None, "1-1", planner="integrated")) == "Case 1-1: "


def test_a_case_as_it_is_and_a_move_without_a_case_have_nothing_to_tell():
    case = load_paper_cases()["1-1"]
    assert (
        format_case_line(build_request(case.start, case.goal, "1-1", (0.5, 0.0, 2.0), "table"))
        == []
    )
    assert format_case_line(build_request(*THERE, planner="integrated")) == []


def test_weights_that_are_all_zero_are_refused_unless_the_area_counts():
    with pytest.raises(ArgumentError, match="any motion would be as good as any other"):
        PlanOptions(weights=Weights(0.0, 0.0, 0.0))
    alone = PlanOptions(weights=Weights(0.0, 0.0, 0.0), area_weight=1.0)
    with pytest.raises(ArgumentError, match="must not all be 0"):
        replace(alone, area_weight=0.0)
