"""Braking: smooth, short, and on the way of the motion that it ends."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mhsb_model.braking import PEAK_DECELERATION, brake_along, brake_from
from mhsb_model.trajectory import SECOND_NS, MotionState, Trajectory, standstill

STAMP = 1_000 * SECOND_NS
MIDDLE = np.array([0.2, -1.0, -1.0])


def swing(duration: float = 4.0) -> Trajectory:
    """All joints to and fro around the middle of their ranges, at rest at both ends."""
    s = np.linspace(0, 1, int(duration / 0.02) + 1)[:, None]
    height = np.array([0.3, -0.4, 0.5])
    shape = 64 * s**3 * (1 - s) ** 3
    slope = 192 * s**2 * (1 - s) ** 2 * (1 - 2 * s) / duration
    bend = 384 * s * (1 - s) * (1 - 5 * s + 5 * s**2) / duration**2
    offset = np.rint(s[:, 0] * duration * SECOND_NS).astype(np.int64)
    return Trajectory(STAMP, offset, MIDDLE + height * shape, height * slope, height * bend)


@given(st.integers(0, 4 * SECOND_NS))
def test_braking_starts_with_the_state_of_the_motion_and_ends_at_rest(machine, since):
    motion = swing()
    braking = brake_along(machine, motion, STAMP + since)
    state = motion.sample(STAMP + since)
    assert braking.stamp_ns == STAMP + since
    assert braking.position[0] == pytest.approx(state.position, abs=1e-12)
    assert braking.velocity[0] == pytest.approx(state.velocity, abs=1e-12)
    assert braking.acceleration[0] == pytest.approx(state.acceleration, abs=1e-9)
    assert not braking.velocity[-1].any()
    assert np.diff(braking.offset_ns).max(initial=0) <= 20_000_000


@given(st.integers(0, 4 * SECOND_NS))
def test_braking_along_a_path_does_not_leave_it_and_is_not_faster_than_it(machine, since):
    motion = swing()
    braking = brake_along(machine, motion, STAMP + since)
    at = braking.stamp_ns + np.arange(0, braking.duration_ns + 1, 1_000_000)
    q, qd, _ = braking.sample_many(at)
    path, speed, _ = motion.sample_many(STAMP + since + np.arange(0, 500_000_000, 500_000))
    distance = np.abs(q[:, None, :] - path[None, :, :]).max(axis=2)
    assert distance.min(axis=1).max() < 5e-4
    nearest = distance.argmin(axis=1)
    assert np.all(np.abs(qd) <= np.abs(speed[nearest]) + 5e-3)


def test_braking_is_as_short_as_the_deceleration_allows(machine):
    motion = swing()
    state = motion.sample(STAMP + SECOND_NS)
    fastest = np.max(np.abs(machine.moment_arms(state.position) * state.velocity))
    braking = brake_along(machine, motion, STAMP + SECOND_NS)
    assert braking.duration_ns / SECOND_NS == pytest.approx(
        1.5 * fastest / PEAK_DECELERATION, abs=1e-6
    )


def test_braking_velocity_is_the_slope_of_its_position(machine):
    braking = brake_along(machine, swing(), STAMP + SECOND_NS)
    at = braking.stamp_ns + np.arange(1_000_000, braking.duration_ns - 1_000_000, 500_000)
    step = 100_000
    before, after = braking.sample_many(at - step), braking.sample_many(at + step)
    slope = (after[0] - before[0]) / (2 * step / SECOND_NS)
    assert braking.sample_many(at)[1] == pytest.approx(slope, abs=1e-5)


def test_a_motion_that_ends_sooner_than_braking_would_is_kept_to_its_end(machine):
    motion = swing(duration=0.5)
    braking = brake_along(machine, motion, motion.end_ns - 200_000_000)
    assert braking.end_ns == motion.end_ns
    assert braking.position[-1] == pytest.approx(motion.position[-1], abs=0)


@pytest.mark.parametrize("left_ns", [2_000_000, 15_000_000, 45_000_000, 150_000_000])
def test_what_is_left_of_a_motion_is_followed_exactly(machine, left_ns):
    """Also where it decelerates sharply, which no braking from its state alone could follow."""
    motion = swing(duration=0.5)
    braking = brake_along(machine, motion, motion.end_ns - left_ns)
    at = braking.stamp_ns + np.linspace(0, left_ns, 50).astype(np.int64)
    q, qd, _ = braking.sample_many(at)
    expected, rate, _ = motion.sample_many(at)
    assert q == pytest.approx(expected, abs=1e-9)
    assert qd == pytest.approx(rate, abs=1e-6)


def test_an_arm_at_rest_brakes_with_a_single_point(machine):
    assert brake_along(machine, standstill(MIDDLE, STAMP), STAMP + 5).duration_ns == 0
    assert brake_along(machine, swing(), STAMP + 60 * SECOND_NS).duration_ns == 0
    assert brake_from(machine, MotionState.at_rest(MIDDLE), STAMP).duration_ns == 0


@given(st.integers(0, 2**32))
def test_braking_from_a_state_takes_over_its_velocity_and_acceleration(machine, seed):
    random = np.random.default_rng(seed)
    state = MotionState(MIDDLE, random.uniform(-0.5, 0.5, 3), random.uniform(-1, 1, 3))
    braking = brake_from(machine, state, STAMP)
    assert braking.position[0] == pytest.approx(state.position)
    assert braking.velocity[0] == pytest.approx(state.velocity)
    assert braking.acceleration[0] == pytest.approx(state.acceleration)
    assert not braking.velocity[-1].any()
    assert not braking.acceleration[-1].any()


def test_braking_from_a_state_keeps_joint_limits_where_it_can(machine):
    upper = machine.arrays.joint_max
    towards = MotionState(upper - 0.02, np.full(3, 0.25), np.zeros(3))
    braking = brake_from(machine, towards, STAMP)
    assert np.all(braking.position <= upper)
    assert (
        braking.duration_ns
        < brake_from(machine, MotionState(MIDDLE, np.full(3, 0.25), np.zeros(3)), STAMP).duration_ns
    )
