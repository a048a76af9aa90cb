"""What the stamps of an arm tell of its clock."""

import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mhsb_model.trajectory import SECOND_NS
from mhsb_planner.online.arm_clock import ArmClockEstimator

delays = st.lists(st.floats(0.0, 0.05), min_size=120, max_size=160)


def in_order(delays) -> list[float]:
    """When messages sent 10 ms apart arrive, none before the one ahead of it [s]."""
    return list(itertools.accumulate((0.01 * k + d for k, d in enumerate(delays)), max))


def heard(speed, delays) -> ArmClockEstimator:
    """Stamps from 7 s on, 10 ms of the real time apart."""
    arm = ArmClockEstimator()
    for k, arrival in enumerate(in_order(delays)):
        assert arm.add_stamp(round((7.0 + speed * 0.01 * k) * SECOND_NS), arrival)
    return arm


@settings(max_examples=25)
@given(delays)
def test_a_clock_heard_with_delays_is_behind_by_the_least_delay_at_most(delays):
    arm, now = heard(1.0, delays), len(delays) * 0.01 + 0.05
    behind = (7.0 + now) - arm.extrapolate_ns(now) / SECOND_NS
    late = [arrival - 0.01 * k for k, arrival in enumerate(in_order(delays))]
    assert arm.speed == 1.0
    assert -1e-6 <= behind <= min(late[-80:]) + 1e-6


@pytest.mark.parametrize("speed", [0.4, 3.0, 20.0])
def test_the_speed_of_a_simulated_clock_is_learnt(speed):
    arm = heard(speed, [0.001] * 300)
    assert arm.speed == pytest.approx(speed)
    assert arm.extrapolate_ns(3.5) / SECOND_NS == pytest.approx(
        7.0 + speed * 3.499, abs=0.001 * speed
    )


def test_a_clock_that_goes_back_is_noticed_and_believed():
    arm = heard(1.0, [0.001] * 50)
    assert not arm.add_stamp(SECOND_NS, 1.0)
    assert arm.extrapolate_ns(1.5) == SECOND_NS + SECOND_NS // 2


@pytest.mark.parametrize("speed", [0.4, 1.0, 3.0])
def test_a_clock_that_was_set_ahead_does_not_count_as_a_fast_one(speed):
    arm = heard(speed, [0.001] * 300)
    assert arm.add_stamp(100 * SECOND_NS, 3.01)
    assert arm.extrapolate_ns(3.11) == pytest.approx((100.0 + 0.1 * arm.speed) * SECOND_NS)
    assert arm.speed == 1.0  # until it is known again
    assert arm.add_stamp(round((100.0 + 0.01 * speed) * SECOND_NS), 3.02)


def test_an_arm_that_was_never_heard_has_no_time():
    arm = ArmClockEstimator()
    assert arm.time_since_last_stamp(5.0) == float("inf")
    with pytest.raises(ValueError, match="no stamp"):
        arm.extrapolate_ns(5.0)


def test_silence_is_told_from_the_last_stamp():
    assert heard(1.0, [0.0] * 11).time_since_last_stamp(0.4) == pytest.approx(0.3)
