"""Deadlines on a clock that the test sets."""

from __future__ import annotations

import math

import pytest

from mhsb_planner import deadline as deadline_module
from mhsb_planner.deadline import NO_DEADLINE, Deadline
from mhsb_planner.errors import DeadlineError


class Clock:
    """Shows what it is set to."""

    time = 100.0

    def __call__(self) -> float:
        """The time [s]."""
        return self.time


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    """The clock of all deadlines."""
    clock = Clock()
    monkeypatch.setattr(deadline_module, "now", clock)
    return clock


def test_a_deadline_stays_where_it_is_while_time_goes_on(clock: Clock) -> None:
    deadline = Deadline.after(0.5)
    assert deadline.remaining == pytest.approx(0.5)
    clock.time += 0.3
    assert deadline.remaining == pytest.approx(0.2)
    assert not deadline.has_passed
    clock.time += 0.2
    assert deadline.has_passed
    clock.time += 1.0
    assert deadline.remaining == pytest.approx(-1.0)


def test_a_reserve_brings_it_nearer(clock: Clock) -> None:
    deadline = Deadline.after(0.5).earlier_by(0.4)
    assert deadline.remaining == pytest.approx(0.1)
    assert deadline < Deadline.after(0.5)


@pytest.mark.parametrize("seconds", [0.0, -1.0])
def test_no_time_is_over_at_once(clock: Clock, seconds: float) -> None:
    assert Deadline.after(seconds).has_passed


def test_never_does_not_pass(clock: Clock) -> None:
    clock.time = 1e12
    for deadline in (NO_DEADLINE, NO_DEADLINE.earlier_by(1e9), Deadline.after(math.inf)):
        assert deadline == NO_DEADLINE
        assert not deadline.has_passed
        assert deadline.remaining == math.inf


def test_a_check_says_what_came_to_nothing(clock: Clock) -> None:
    deadline = Deadline.after(0.5)
    deadline.check("the work")
    clock.time += 1.0
    with pytest.raises(DeadlineError, match="the work did not end before the deadline"):
        deadline.check("the work")


def test_portions_take_about_a_millisecond_each_until_the_deadline(clock: Clock) -> None:
    sizes = []
    for size in Deadline.after(0.1).portions(1, 50):
        sizes.append(size)
        clock.time += 40e-6 * size  # 25 of them in a millisecond
    assert sizes[:3] == [1, 10, 25]
    assert set(sizes[2:]) == {25}
    assert clock.time == pytest.approx(100.1, abs=1.1e-3)


def test_without_hurry_portions_are_as_large_as_they_may_be(clock: Clock) -> None:
    portions = NO_DEADLINE.portions(1, 50)
    assert [next(portions) for _ in range(3)] == [50, 50, 50]


def test_after_the_deadline_there_is_no_portion(clock: Clock) -> None:
    assert list(Deadline.after(0.0).portions(1, 50)) == []


def test_not_a_number_is_no_deadline(clock: Clock) -> None:
    with pytest.raises(ValueError, match="not NaN"):
        Deadline.after(math.nan)
