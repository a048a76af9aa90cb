"""Limits within which a linkage cannot be used are refused, each with one sentence."""

import re

import pytest

from mhsb_model.errors import MachineFileError
from mhsb_model.machine import Machine
from mhsb_model.schema import MachineConfig


@pytest.fixture
def refusals(four_bar_machine):
    """Problems of the four-bar machine after a change to its first joint, by dotted keys."""

    def load(change: dict) -> tuple[str, ...]:
        content = four_bar_machine.config.model_dump()
        for keys, value in change.items():
            place = content["joints"][0]
            *path, last = keys.split(".")
            for key in path:
                place = place[key]
            place[last] = value
        with pytest.raises(MachineFileError) as caught:
            Machine.from_config(MachineConfig.model_validate(content))
        return caught.value.problems

    return load


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (
            {"linkage.coupler_length": 0.03},
            r"joints\.0\.linkage: the four-bar cannot be assembled at .* rad within \[-1\.571, "
            r"2\.269\] rad, where rocker pivot and child pin are 0\.\d+ m apart and rocker and "
            r"coupler span 0\.0668 … 0\.1268 m: narrow the limits or change the lengths",
        ),
        (
            {"limits.lower": -1.75},
            r"joints\.0\.linkage: rocker and coupler come within 0\.3254 rad of one line at "
            r"-1\.75 rad within .*, where the four-bar locks; they must stay 0\.3491 rad away",
        ),
        (
            {"limits.upper": 3.0},
            r"joints\.0\.limits: the moment arm falls to 0\.01028 m within .*, it must stay above "
            r"0\.01337 m: narrow the limits or move the pins",
        ),
        (
            {"linkage.parent_pin.radius": 0.22},
            r"joints\.0\.linkage: the cylinder goes from \S+ m to \S+ m within .*, it must stay "
            r"below twice its shortest length: narrow the limits or move the parent pin away",
        ),
    ],
)
def test_a_four_bar_that_its_limits_do_not_suit_is_refused(refusals, change, sentence):
    assert any(re.match(sentence, problem) for problem in refusals(change)), refusals(change)


def test_what_cannot_be_assembled_is_not_judged_further(refusals):
    assert len(refusals({"linkage.coupler_length": 0.03})) == 1


def test_a_change_over_between_the_two_assemblies_is_refused_even_where_the_arm_is_fine(refusals):
    (problem,) = refusals({"limits.lower": -1.75})
    assert "the four-bar locks" in problem


def test_the_moment_arm_must_not_change_its_sign(refusals):
    problems = refusals({"linkage.parent_pin.angle": -1.2})
    assert any("moment arm falls to 0 m" in problem for problem in problems), problems


def test_slider_cranks_have_to_keep_the_same_rules(machine):
    content = machine.config.model_dump()
    content["joints"][0]["linkage"]["parent_pin"]["radius"] = 0.11
    with pytest.raises(MachineFileError, match="below twice its shortest length"):
        Machine.from_config(MachineConfig.model_validate(content))


@pytest.fixture
def refused_crank(slider_crank_machine):
    """Slider-crank of which child pin's angle is wrong by 0.6 rad, and the sentence about it."""
    content = slider_crank_machine.config.model_dump(mode="json")
    content["joints"][0]["linkage"]["child_pin"]["angle"] += 0.6
    with pytest.raises(MachineFileError) as caught:
        Machine.from_config(MachineConfig.model_validate(content))
    [sentence] = caught.value.problems
    return content, sentence


def test_limits_that_a_refusal_names_are_accepted_and_no_wider_ones(refused_crank):
    content, sentence = refused_crank
    low, high = map(
        float, re.search(r"these pins \[(.+), (.+)\] rad is possible", sentence).groups()
    )
    limits = content["joints"][0]["limits"]
    assert (low, high) != (limits["lower"], limits["upper"])
    content["simulation"]["start_posture"][0] = 0.5 * (low + high)
    wider = (max(low - 0.01, limits["lower"]), min(high + 0.01, limits["upper"]))
    limits["lower"], limits["upper"] = low, high
    Machine.from_config(MachineConfig.model_validate(content))
    limits["lower"], limits["upper"] = wider
    with pytest.raises(MachineFileError, match="moment arm"):
        Machine.from_config(MachineConfig.model_validate(content))


def test_the_angle_of_a_pin_that_a_refusal_names_allows_the_limits(refused_crank):
    content, sentence = refused_crank
    angle = float(re.search(r"child_pin\.angle (.+) rad allows these limits", sentence)[1])
    content["joints"][0]["linkage"]["child_pin"]["angle"] = angle
    Machine.from_config(MachineConfig.model_validate(content))


def test_no_angle_is_named_if_none_allows_the_limits(refused_crank):
    content, _ = refused_crank
    content["joints"][0]["limits"] |= {"lower": -1.4, "upper": 1.4}
    with pytest.raises(MachineFileError) as caught:
        Machine.from_config(MachineConfig.model_validate(content))
    assert "allows these limits" not in str(caught.value)
    assert "is possible" in str(caught.value)
