"""Times of ROS as integer nanoseconds."""

from __future__ import annotations

import pytest
from builtin_interfaces.msg import Time
from hypothesis import given
from hypothesis import strategies as st
from rclpy.duration import Duration as RclpyDuration
from rclpy.time import Time as RclpyTime

from mhsb_msgs_py import stamps
from mhsb_msgs_py.errors import MessageError

RANGE = st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1)


@given(st.integers(0, 2**31 * 10**9 - 1))
def test_times_are_those_of_rclpy(time_ns):
    assert stamps.to_time(time_ns) == RclpyTime(nanoseconds=time_ns).to_msg()
    assert stamps.from_time(RclpyTime(nanoseconds=time_ns).to_msg()) == time_ns


@given(RANGE)
def test_durations_are_those_of_rclpy(duration_ns):
    assert stamps.from_time(RclpyDuration(nanoseconds=duration_ns).to_msg()) == duration_ns


@given(RANGE)
def test_the_text_of_a_time_loses_nothing(time_ns):
    assert stamps.from_text(stamps.to_text(time_ns)) == time_ns


def test_the_text_of_a_time_is_its_seconds():
    assert stamps.to_text(12_000_000_005) == "12.000000005"


@pytest.mark.parametrize("text", ["", "12", "1.5", "1,000000000", "a.000000000", "--1.000000000"])
def test_another_text_is_refused(text):
    with pytest.raises(MessageError, match="give seconds with nine decimals"):
        stamps.from_text(text)


def test_a_time_beyond_32_bits_of_seconds_cannot_be_sent():
    with pytest.raises(ValueError, match="does not fit"):
        stamps.to_time(2**31 * 10**9)


def test_nanoseconds_that_make_a_second_are_refused():
    with pytest.raises(MessageError, match="must be below 1000000000"):
        stamps.from_time(Time(sec=1, nanosec=1_000_000_000))


def test_a_time_of_thousands_of_digits_is_refused_in_one_sentence():
    with pytest.raises(MessageError, match="cannot be read; give seconds with nine decimals"):
        stamps.from_text("9" * 5000 + ".000000000")


@given(st.integers(0, stamps.LATEST_PRESENT), st.integers(0, 10**9 - 1))
def test_a_clock_shows_a_time_after_which_there_are_others(seconds, nanoseconds):
    shown = stamps.from_clock(Time(sec=seconds, nanosec=nanoseconds))
    assert shown == seconds * 10**9 + nanoseconds
    assert stamps.to_time(shown + 10**16).sec > seconds


@pytest.mark.parametrize("seconds", [-1, -(2**31), stamps.LATEST_PRESENT + 1, 2**31 - 1])
def test_a_clock_that_shows_another_time_is_refused(seconds):
    with pytest.raises(MessageError, match=f"a clock shows {seconds} s; it must be from 0 to"):
        stamps.from_clock(Time(sec=seconds))


def test_a_clock_with_a_second_of_nanoseconds_is_refused():
    with pytest.raises(MessageError, match="must be below 1000000000"):
        stamps.from_clock(Time(sec=1, nanosec=10**9))
