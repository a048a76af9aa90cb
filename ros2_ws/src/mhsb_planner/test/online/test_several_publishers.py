"""Publishers of a reference whose clocks differ are named, not taken for a clock that was set."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mhsb_model.trajectory import SECOND_NS
from mhsb_model.verdict import Outcome, Verdict
from mhsb_planner.online.arm_clock import (
    DECIDED_AFTER,
    SECOND_PUBLISHER_TIMEOUT,
    Order,
    StampOrder,
)

UP, DOWN = (0.55, 0.60), (0.55, -0.60)
LAGS = (5.0, 0.3, -4.0)


def backs(world):
    return sum("clock went back" in each for each in world.warnings)


def under_way(world):
    stamp = world.send_goal(*UP)
    world.pass_time_until(lambda: world.arm.is_moving)
    world.pass_time(1.0)
    return stamp


@pytest.mark.parametrize("lag", LAGS)
def test_every_goal_beside_a_second_publisher_gets_one_verdict_that_names_it(world, lag):
    world.second_lag = lag
    world.pass_time(3.0)
    for goal in (UP, DOWN):
        verdict = world.verdict(world.send_goal(*goal))
        assert verdict.code is Verdict.NO_STATE
        assert "2 publishers" in verdict.sentence
    assert backs(world) == 0


@pytest.mark.parametrize("lag", LAGS)
def test_an_execution_beside_a_second_publisher_ends_once_with_its_reason(world, lag):
    stamp = under_way(world)
    world.second_lag = lag
    ending = world.execution_report(stamp)
    assert ending.outcome is Outcome.ABORTED
    assert "2 publishers" in ending.sentence
    assert backs(world) == 0
    assert sum("2 publishers" in each for each in world.warnings) == 1


@pytest.mark.parametrize("lag", LAGS)
def test_a_stop_beside_a_second_publisher_brings_the_arm_to_rest(world, lag):
    under_way(world)
    world.second_lag = lag
    world.pass_time(0.3)
    answers = []
    world.life.stop(lambda *answer: answers.append(answer))
    world.pass_time_until(lambda: bool(answers))
    assert answers == [(True, "the arm stands still")]
    assert not world.arm.is_moving


@pytest.mark.parametrize("lag", LAGS)
def test_goals_are_planned_for_again_once_the_second_publisher_has_gone(world, lag):
    world.second_lag = lag
    world.pass_time(3.0)
    world.second_lag = 0.0
    world.pass_time(SECOND_PUBLISHER_TIMEOUT + 0.1)
    assert world.execution_report(world.send_goal(*UP)).outcome is Outcome.REACHED


def heard(order, stamps):
    """Orders of stamps [s] that are heard 10 ms apart."""
    return [order.add_stamp(round(stamp * SECOND_NS), 0.01 * k) for k, stamp in enumerate(stamps)]


@given(
    st.floats(0.05, 100.0),
    st.lists(st.booleans(), min_size=300, max_size=300),
    st.integers(1, 20),
)
def test_two_clocks_in_any_mixture_are_never_taken_for_one_that_was_set(lag, firsts, longest):
    """Neither of both is silent for more than 20 messages."""
    order, run, stamps = StampOrder(lambda: "two"), 0, []
    for k, first in enumerate(firsts):
        run = run + 1 if k and first == firsts[k - 1] else 1
        chosen = first if run <= longest else not first
        stamps.append(100.0 + 0.01 * k - (0.0 if chosen else lag))
    assert Order.BACK not in heard(order, stamps)


@given(st.floats(1.2, 100.0))
def test_a_clock_that_was_set_back_is_believed_once_beside_a_publisher_that_was_killed(back):
    order = StampOrder(lambda: "two")
    stamps = [100.0 + 0.01 * k - (back if k >= 50 else 0.0) for k in range(300)]
    orders = heard(order, stamps)
    assert orders.count(Order.BACK) == 1
    assert orders.index(Order.BACK) <= 51 + 100 * DECIDED_AFTER
    assert order.publisher_conflict == ""


@given(st.floats(0.01, 100.0))
def test_the_only_publishers_clock_that_was_set_back_is_believed_at_once(back):
    order = StampOrder(lambda: "")
    stamps = [100.0 + 0.01 * k - (back + 0.02 if k >= 50 else 0.0) for k in range(100)]
    orders = heard(order, stamps)
    assert [k for k, each in enumerate(orders) if each is Order.BACK] == [50]
