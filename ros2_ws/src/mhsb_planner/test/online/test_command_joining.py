"""Plan hand-over: a message repeats the old curve up to the change, then leaves it smoothly."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mhsb_model.braking import MIN_POINT_SPACING_NS
from mhsb_model.command import Command
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_planner.online.command_joining import choose_hand_over_times, join_commands

STAMP = 1_700_000_000 * SECOND_NS
BUDGET = 100_000_000
MIDDLE = np.array([0.2, -1.0, -1.0])


def swing(stamp=STAMP, duration=3.0, spacing=0.02, start=MIDDLE):
    """A command that swings all joints and comes to rest at its end."""
    s = np.linspace(0, 1, int(duration / spacing) + 1)[:, None]
    height = np.array([0.3, -0.4, 0.5])
    trajectory = Trajectory(
        stamp,
        np.rint(s[:, 0] * duration * SECOND_NS).astype(np.int64),
        start + height * 64 * s**3 * (1 - s) ** 3,
        height * 192 * s**2 * (1 - s) ** 2 * (1 - 2 * s) / duration,
        height * 384 * s * (1 - s) * (1 - 5 * s + 5 * s**2) / duration**2,
    )
    rows = [0, SECOND_NS // 2, SECOND_NS, trajectory.duration_ns]
    schedule = ModeSchedule(stamp, rows, [[0, 0, 0], [1, 0, 0], [2, 1, 0], [1, 0, 0]])
    return Command(trajectory, schedule)


def coasting(state, duration=2.0):
    """A new part from any state to rest, in other modes."""
    s = np.linspace(0, 1, 101)[:, None]
    v, a = state.velocity, state.acceleration * duration
    trajectory = Trajectory(
        0,
        np.rint(s[:, 0] * duration * SECOND_NS).astype(np.int64),
        state.position
        + duration * (v * (s - s**3 + s**4 / 2) + a * (s**2 / 2 - 2 * s**3 / 3 + s**4 / 4)),
        v * (1 - 3 * s**2 + 2 * s**3) + a * (s - 2 * s**2 + s**3),
        (v * (6 * s**2 - 6 * s) + a * (1 - 4 * s + 3 * s**2)) / duration,
    )
    schedule = ModeSchedule(0, [0, trajectory.duration_ns], [[0, 2, 0], [0, 1, 0]])
    return Command(trajectory, schedule)


def taken_over(command, now, budget=BUDGET):
    times = choose_hand_over_times(command, now, budget)
    return times, join_commands(
        command, times, coasting(command.trajectory.sample(times.change_ns))
    )


@settings(max_examples=60)
@given(st.integers(-SECOND_NS, 4 * SECOND_NS), st.integers(20_000_000, 300_000_000))
def test_both_messages_describe_the_very_same_curve_up_to_the_change(since, budget):
    old = swing()
    times, new = taken_over(old, STAMP + since, budget)
    at = times.stamp_ns + np.linspace(0, budget, 301).astype(np.int64)
    before, after = old.trajectory.sample_many(at), new.trajectory.sample_many(at)
    assert after[0] == pytest.approx(before[0], abs=1e-12)
    assert after[1] == pytest.approx(before[1], abs=1e-10)
    assert after[2] == pytest.approx(before[2], abs=1e-7)
    assert np.array_equal(old.schedule.modes_at_many(at[:-1]), new.schedule.modes_at_many(at[:-1]))


@given(st.integers(-SECOND_NS, 4 * SECOND_NS))
def test_position_velocity_and_acceleration_are_continuous_at_the_change(since):
    old = swing()
    times, new = taken_over(old, STAMP + since)
    around = times.change_ns + np.array([-1, 0, 1])
    q, qd, qdd = new.trajectory.sample_many(around)
    assert np.ptp(q, axis=0) == pytest.approx(np.zeros(3), abs=1e-8)
    assert np.ptp(qd, axis=0) == pytest.approx(np.zeros(3), abs=1e-7)
    assert np.ptp(qdd, axis=0) == pytest.approx(np.zeros(3), abs=1e-6)


@settings(max_examples=200)
@given(st.integers(0, 4 * SECOND_NS), st.integers(1_000_000, 300_000_000))
def test_points_are_neither_too_close_nor_too_far_apart(since, budget):
    old = swing()
    times, new = taken_over(old, STAMP + since, budget)
    gaps = np.diff(new.trajectory.offset_ns)
    assert gaps.min() >= MIN_POINT_SPACING_NS
    assert gaps.max() <= 20_000_000  # what receivers allow
    assert 0 <= times.stamp_ns - (STAMP + since) <= 10_000_000
    assert times.change_ns - times.stamp_ns == budget


def test_an_old_point_just_after_now_becomes_the_stamp():
    old = swing()
    assert (
        choose_hand_over_times(old, STAMP + 400_000_000 - 1, BUDGET).stamp_ns == STAMP + 400_000_000
    )
    assert choose_hand_over_times(old, STAMP + 400_000_000, BUDGET).stamp_ns == STAMP + 400_000_000


def test_stamps_increase_strictly_even_if_the_clock_does_not():
    command, now = swing(), STAMP + SECOND_NS
    for _ in range(5):
        times, new = taken_over(command, now)
        assert times.stamp_ns > command.stamp_ns
        command = new


def test_many_hand_overs_in_a_row_stay_on_one_curve():
    command, now = swing(), STAMP + 100_000_000
    for step in range(40):
        times = choose_hand_over_times(command, now, BUDGET)
        new = join_commands(command, times, coasting(command.trajectory.sample(times.change_ns)))
        at = times.stamp_ns + np.arange(0, BUDGET, 1_000_000)
        drift = np.abs(new.trajectory.sample_many(at)[0] - command.trajectory.sample_many(at)[0])
        assert drift.max() < 1e-12
        command, now = new, now + 37_000_001 + 13 * step


def test_after_the_old_motion_has_ended_the_prefix_holds():
    old = swing()
    times, new = taken_over(old, old.trajectory.end_ns + SECOND_NS)
    at = times.stamp_ns + np.arange(0, BUDGET, 1_000_000)
    q, qd, _ = new.trajectory.sample_many(at)
    assert q == pytest.approx(np.broadcast_to(old.trajectory.position[-1], q.shape), abs=1e-15)
    assert not qd.any()
    assert new.schedule.modes_at(times.stamp_ns).tolist() == [1, 0, 0]


def test_a_motion_that_ends_within_the_prefix_is_repeated_and_then_held():
    old = swing()
    times, new = taken_over(old, old.trajectory.end_ns - 50_000_000)
    at = times.stamp_ns + np.arange(0, BUDGET, 1_000_000)
    before, after = old.trajectory.sample_many(at), new.trajectory.sample_many(at)
    assert after[0] == pytest.approx(before[0], abs=1e-12)


def test_old_switches_stay_where_they_were_and_new_ones_follow_the_change():
    old = swing()
    times, new = taken_over(old, STAMP + 450_000_000)
    schedule = new.schedule
    assert schedule.stamp_ns == times.stamp_ns == new.trajectory.stamp_ns
    assert schedule.modes_at(STAMP + SECOND_NS // 2 - 1).tolist() == [0, 0, 0]
    assert schedule.modes_at(STAMP + SECOND_NS // 2).tolist() == [1, 0, 0]
    assert schedule.modes_at(times.change_ns).tolist() == [0, 2, 0]
    assert schedule.end_ns == new.trajectory.end_ns


def test_a_held_arm_is_handed_over_like_a_moving_one():
    held = Command.hold(STAMP, MIDDLE, np.array([0, 1, 0], dtype=np.uint8))
    times, new = taken_over(held, STAMP + SECOND_NS)
    q = new.trajectory.sample_many(np.array([times.stamp_ns, times.change_ns]))[0]
    assert q == pytest.approx(np.array([MIDDLE, MIDDLE]), abs=1e-15)
    assert new.schedule.modes_at(times.stamp_ns).tolist() == [0, 1, 0]


def test_a_budget_below_the_closest_points_is_refused():
    with pytest.raises(ValueError, match="too short"):
        choose_hand_over_times(swing(), STAMP, 10)
