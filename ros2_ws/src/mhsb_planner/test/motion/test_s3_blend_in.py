"""Coasting from any state of motion, and paths that set out from it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mhsb_model.trajectory import SECOND_NS, MotionState
from mhsb_planner.motion.piston_motion import convert_to_joints
from mhsb_planner.motion.s3_blend_in import compute_coasting
from mhsb_planner.motion.s3_following import compute_followed_path
from mhsb_planner.motion.s3_ramps import compute_shortest_ramp, evaluate_ramp

V_MAX = 0.012


def state_within_a_ramp(machine, random):
    """A state (v, v̇ and the joints') while pistons pass from one speed to another, same sense."""
    ramp, sign = compute_shortest_ramp(machine), random.choice([-1.0, 1.0], 3)
    before, after = (sign * random.choice([0.0, 1.0, random.random()], 3) * V_MAX for _ in "ab")
    _, share, rate = evaluate_ramp(ramp.rise, ramp.blend, random.uniform(0, ramp.duration))
    speed, acceleration = before + share * (after - before), rate * (after - before)
    q = random.uniform(machine.arrays.joint_min + 0.1, machine.arrays.joint_max - 0.1)
    return speed, acceleration, joint_state(machine, q, speed, acceleration)


def joint_state(machine, q, speed, acceleration):
    arm = machine.moment_arms(q)
    slope = (machine.moment_arms(q + 1e-6) - machine.moment_arms(q - 1e-6)) / 2e-6
    qd = speed / arm
    return MotionState(q, qd, (acceleration - slope * qd**2) / arm)


@settings(max_examples=60)
@given(st.integers(0, 2**32))
def test_coasting_begins_in_the_state_and_ends_at_rest_within_all_limits(machine, seed):
    random, m = np.random.default_rng(seed), machine.arrays
    speed, acceleration, state = state_within_a_ramp(machine, random)
    coast = compute_coasting(machine, state)
    motion = coast.motion
    length, v, a = motion.sample_pistons(np.array([0.0, motion.end]))
    assert length[0] == pytest.approx(machine.cylinder_lengths(state.position), abs=1e-15)
    assert v == pytest.approx(np.vstack([speed, np.zeros(3)]), abs=1e-10)
    assert a[0] == pytest.approx(acceleration, abs=1e-7)
    assert a[1] == pytest.approx(np.zeros(3), abs=1e-11)  # rounding of a time of some seconds
    t = np.arange(0, motion.end, 1e-4)
    _, v, a = motion.sample_pistons(t)
    assert np.abs(v).max() <= V_MAX * (1 + 1e-6)
    assert np.abs(a).max() <= m.max_piston_acceleration * (1 + 1e-6)
    assert motion.end <= 0.3
    assert np.array_equal(coast.trajectory.position[0], state.position)
    assert np.array_equal(coast.trajectory.acceleration[0], state.acceleration)
    assert coast.posture == pytest.approx(motion.sample(np.array([motion.end]))[0][0], abs=1e-9)


def test_almost_all_coasting_is_within_the_jerk_limit(machine):
    random = np.random.default_rng(1)
    motions = [
        compute_coasting(machine, state_within_a_ramp(machine, random)[2]) for _ in range(300)
    ]
    assert sum(not coast.motion.keeps_dynamic_limits for coast in motions) <= 9


def test_a_steady_motion_coasts_for_half_a_ramp(machine):
    q, speed = np.array([0.3, -1.4, -1.0]), np.array([V_MAX, -0.5 * V_MAX, 0.0])
    coast = compute_coasting(machine, joint_state(machine, q, speed, 0.0))
    way = machine.cylinder_lengths(coast.posture) - machine.cylinder_lengths(q)
    assert way == pytest.approx(0.5 * compute_shortest_ramp(machine).duration * speed, abs=1e-9)


@pytest.mark.parametrize(
    ("share", "lost"),
    [(0.003, 0.06), (0.01, 0.06), (0.02, 0.06), (0.3, 0.01), (0.7, 0.01), (0.97, 0.03)],
)
def test_an_arm_that_goes_on_as_it_moves_loses_no_time(machine, walk, share, lost):
    """The rest of a path, followed from where the arm would coast to, lasts as long as before.

    Less than half a ramp is lost where the speed is still changing.
    """
    path = walk(np.random.default_rng(5), 1, leap=0.0)
    first = compute_followed_path(machine, path, 1.0, None, 4.0)
    at = share * first.end
    state = MotionState(*(rows[0] for rows in first.sample(np.array([at]))))
    coast = compute_coasting(machine, state)
    left = np.vstack([coast.posture, path.posture[-1]])
    stroke = np.abs(np.diff([machine.cylinder_lengths(q) for q in left], axis=0)).max()
    whole = np.abs(np.diff([machine.cylinder_lengths(q) for q in path.posture], axis=0)).max()
    rest = replace(
        path,
        posture=left,
        tip=np.array([machine.tip_position(q) for q in left]),
        duration=path.duration * stroke / whole,
    )
    second = compute_followed_path(machine, rest, 1.0, coast, 4.0)
    assert at + second.end == pytest.approx(first.end, abs=lost)
    between = np.linspace(0, second.end, 300)
    _, v, _ = second.sample_pistons(between)
    assert np.abs(v).max() <= V_MAX * (1 + 1e-6)


def test_a_path_that_turns_back_sets_out_later_and_within_the_acceleration(machine, walk):
    q, m = np.array([0.3, -1.4, -1.0]), machine.arrays
    coast = compute_coasting(machine, joint_state(machine, q, np.full(3, V_MAX), 0.0))
    path = walk(np.random.default_rng(9), 6, start=coast.posture, leap=0.0)
    motion = compute_followed_path(machine, path, 1.0, coast, 1.0)
    assert motion.keeps_dynamic_limits
    t = np.arange(0, motion.end, 1e-4)
    assert np.abs(motion.sample_pistons(t)[2]).max() <= m.max_piston_acceleration * (1 + 1e-6)
    assert motion.end * SECOND_NS > 0


@pytest.mark.parametrize("slower", [1.0, 2.2, 4.0])
def test_speeds_that_stay_do_not_sink_however_slow_the_other_ramps_are(machine, walk, slower):
    q, speed = np.array([0.3, -1.4, -1.0]), np.array([V_MAX, -0.5 * V_MAX, 0.2 * V_MAX])
    coast = compute_coasting(machine, joint_state(machine, q, speed, 0.0))
    step = walk(np.random.default_rng(9), 1, start=coast.posture, leap=0.0)
    here = machine.cylinder_lengths(coast.posture)
    way = np.vstack([here, here + 1.0 * speed])
    still = np.zeros_like(way)
    postures = convert_to_joints(machine.arrays, way, still, still, coast.posture)[0]
    path = replace(step, posture=postures, duration=np.ones(1))
    motion = compute_followed_path(machine, path, slower, coast, 1.0)
    until = motion.end - motion.rise[-1] - motion.blend[-1]
    _, v, a = motion.sample_pistons(np.linspace(0.0, until, 100))
    assert v == pytest.approx(np.tile(speed, (100, 1)), abs=1e-8)
    assert a == pytest.approx(np.zeros((100, 3)), abs=1e-6)
    end = motion.sample(np.array([0.0, motion.end]))[0][-1]
    assert end == pytest.approx(postures[-1], abs=1e-9)
