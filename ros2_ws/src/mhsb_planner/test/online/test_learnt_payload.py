"""The payload that plans are made for, by what the arm has learnt."""

import pytest

from mhsb_model.arm_reports import Estimate
from mhsb_planner.online.settings import choose_payload


def learnt(value: float, deviation: float, known: bool = True) -> list[Estimate]:
    other = Estimate("friction", "actuator_1", 1.5, 0.01, True)
    return [other, Estimate("payload", "", value, deviation, known)]


def test_a_payload_that_is_known_well_is_planned_with():
    assert choose_payload(learnt(12.0, 0.6), None) == 12.0


@pytest.mark.parametrize(
    "estimates", [[], learnt(12.0, 0.7), learnt(12.0, 0.1, known=False), learnt(0.0, 0.0)]
)
@pytest.mark.parametrize("before", [None, 9.0])
def test_what_is_not_known_well_leaves_it_as_it_was(estimates, before):
    assert choose_payload(estimates, before) == before


def test_small_changes_are_not_worth_new_prices():
    assert choose_payload(learnt(12.3, 0.1), 12.0) == 12.0
    assert choose_payload(learnt(12.4, 0.1), 12.0) == 12.4
