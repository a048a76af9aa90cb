"""Following a path from a moving start: one smooth motion that ends where the path ends."""

import numpy as np
import pytest

from mhsb_model.braking import brake_along
from mhsb_model.trajectory import SECOND_NS, MotionState
from mhsb_model.workspace import node_set_excess
from mhsb_planner.integrated.route import new_memory, path_of, price_route, terms
from mhsb_planner.motion.s3_following import followed_path
from mhsb_planner.motion.s3_piecewise import smoothed_path
from mhsb_planner.motion.s3_trajectory import FitMethod, FitRules, fit_trajectory
from mhsb_planner.motion.s4_mode_schedule import StartModes
from mhsb_planner.search.discrete_path import SearchStatistics

NORMAL = StartModes.settled([0, 0, 0])
RULES = FitRules.following()


def left_on_the_way(machine, walk, seed):
    """A motion left half-way: its state there, how it brakes, and a path on from where it rests."""
    random = np.random.default_rng(seed)
    first = walk(random, 6, leap=0.0)
    going = fit_trajectory(
        machine, first, MotionState.at_rest(first.posture[0]), NORMAL, rules=RULES
    )
    at_ns = going.trajectory.duration_ns // 2
    brake = brake_along(machine, going.trajectory, at_ns)
    return going, going.trajectory.sample(at_ns), brake, walk(random, 5, brake.position[-1], 0.0)


def lengths(machine, position):
    return np.array([machine.cylinder_lengths(q) for q in position])


def test_the_curve_is_the_path_added_to_what_braking_still_does(machine, walk):
    _, _, brake, path = left_on_the_way(machine, walk, 0)
    curve = followed_path(machine, path, 0.8, brake, 1.0)
    alone = smoothed_path(machine, path, 0.8, 1.0)
    time = np.linspace(0.0, curve.breaks[-1], 200)
    at_ns = brake.stamp_ns + np.rint(time * SECOND_NS).astype(np.int64)
    both = lengths(machine, curve.sample(time)[0])
    rest = lengths(machine, brake.position[-1:])
    expected = lengths(machine, alone.sample(np.minimum(time, alone.breaks[-1]))[0])
    expected += lengths(machine, brake.sample_many(at_ns)[0]) - rest
    assert both == pytest.approx(expected, abs=1e-7)


@pytest.mark.parametrize("seed", range(6))
def test_a_motion_goes_on_smoothly_from_the_one_that_is_left(machine, walk, worst, seed):
    going, state, brake, path = left_on_the_way(machine, walk, seed)
    modes = StartModes.during(going.schedule, brake.stamp_ns)
    motion = fit_trajectory(machine, path, state, modes, brake, RULES)
    trajectory = motion.trajectory
    assert np.array_equal(trajectory.position[0], state.position)
    assert np.array_equal(trajectory.velocity[0], state.velocity)
    assert np.array_equal(trajectory.acceleration[0], state.acceleration)
    assert trajectory.position[-1] == pytest.approx(path.posture[-1], abs=1e-9)
    assert not trajectory.velocity[-1].any()
    dense = np.arange(0, trajectory.duration_ns, 1_000_000)
    q, qd, _ = trajectory.sample_many(dense)
    assert np.diff(q, axis=0) / 1e-3 == pytest.approx(0.5 * (qd[1:] + qd[:-1]), abs=2e-4)
    excess = worst(trajectory, motion.schedule)
    assert excess["joint"] < 1e-6
    assert excess["tip"] < 1.1e-4
    assert max(v for k, v in excess.items() if k not in ("joint", "tip")) < 1e-3, excess
    assert motion.speed_excess < 2e-3


def straight_on(machine, start, strokes):
    """The path that moves the cylinders so far [m], piston speeds constant; None where none is."""
    t = terms(machine, np.zeros(3, dtype=np.uint8), np.array([1.0, 0.0, 0.0]), 1)
    here, memory = machine.cylinder_lengths(start), new_memory(t)
    ends = np.sort(lengths(machine, [machine.arrays.joint_min, machine.arrays.joint_max]), axis=0)
    if np.any(here + strokes < ends[0]) or np.any(here + strokes > ends[1]):
        return None
    via = np.vstack([here, here + strokes])
    cost = price_route(t, memory, via, start, np.inf)
    if not np.isfinite(cost):
        return None
    modes, nothing = np.zeros(3, dtype=np.uint8), SearchStatistics(0, 0, 0.0)
    return path_of(t, memory, via, cost, start, modes, 0.0, nothing)


def test_an_arm_that_goes_on_as_it_moves_keeps_its_speed(machine):
    random = np.random.default_rng(0)
    limits, tried = machine.arrays, 0
    while tried < 5:
        start = random.uniform(limits.joint_min, limits.joint_max)
        strokes = random.uniform(-0.02, 0.02, 3)
        if node_set_excess(limits, *machine.tip_position(start)) > 0.0:
            continue
        first = straight_on(machine, start, strokes)
        if first is None or first.modes.any() or first.duration.sum() < 1.2:
            continue
        rest = MotionState.at_rest(start)
        going = fit_trajectory(machine, first, rest, NORMAL, rules=RULES).trajectory
        at_ns = int(0.3 * going.duration_ns)
        brake = brake_along(machine, going, at_ns)
        left = machine.cylinder_lengths(start) + strokes
        left -= machine.cylinder_lengths(brake.position[-1])
        onward = straight_on(machine, brake.position[-1], left)
        if onward is None or onward.modes.any() or onward.duration.sum() < 0.4:
            continue
        tried += 1
        curve = followed_path(machine, onward, 0.8, brake, 1.0)
        q, qd, _ = curve.sample(np.linspace(0.0, curve.breaks[-1] - 0.5, 50))
        speed = np.abs(np.array([machine.moment_arms(row) for row in q]) * qd).max(axis=1)
        assert speed.min() > 0.75 * limits.max_piston_speed
        assert speed.max() < 1.05 * limits.max_piston_speed


def test_from_rest_v_max_and_the_path_are_kept(machine, walk, worst):
    for seed in range(4):
        path = walk(np.random.default_rng(seed), 8, leap=0.2)
        start = MotionState.at_rest(path.posture[0])
        motion = fit_trajectory(machine, path, start, NORMAL, rules=RULES)
        assert motion.method != FitMethod.POLYNOMIAL
        assert motion.speed_excess < 2e-3
        excess = worst(motion.trajectory, motion.schedule)
        assert max(v for k, v in excess.items() if k not in ("joint", "tip")) < 1e-3, excess
