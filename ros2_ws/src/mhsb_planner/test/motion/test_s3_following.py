"""Following a path from a moving start: one smooth motion that ends where the path ends."""

import numpy as np
import pytest

from mhsb_model.trajectory import MotionState
from mhsb_planner.motion.s3_blend_in import compute_coasting
from mhsb_planner.motion.s3_trajectory import FitMethod, FitRules, fit_trajectory
from mhsb_planner.motion.s4_mode_schedule import StartModes

NORMAL = StartModes.create_settled([0, 0, 0])
RULES = FitRules.create_following()


def left_on_the_way(machine, walk, seed):
    """A motion left half-way: its state there, how it coasts, and a path on from where it rests."""
    random = np.random.default_rng(seed)
    first = walk(random, 6, leap=0.0)
    going = fit_trajectory(
        machine, first, MotionState.at_rest(first.posture[0]), NORMAL, rules=RULES
    )
    at_ns = going.trajectory.duration_ns // 2
    state = going.trajectory.sample(at_ns)
    coast = compute_coasting(machine, state)
    modes = StartModes.read_from(going.schedule, at_ns)
    return state, modes, coast, walk(random, 5, coast.posture, 0.0)


@pytest.mark.parametrize("seed", range(8))
def test_a_motion_goes_on_smoothly_from_the_one_that_is_left(machine, walk, worst, seed):
    state, modes, coast, path = left_on_the_way(machine, walk, seed)
    motion = fit_trajectory(machine, path, state, modes, coast, RULES)
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


def test_from_rest_v_max_and_the_path_are_kept(machine, walk, worst):
    for seed in range(4):
        path = walk(np.random.default_rng(seed), 8, leap=0.2)
        start = MotionState.at_rest(path.posture[0])
        motion = fit_trajectory(machine, path, start, NORMAL, rules=RULES)
        assert motion.method != FitMethod.POLYNOMIAL
        assert motion.speed_excess < 2e-3
        excess = worst(motion.trajectory, motion.schedule)
        assert max(v for k, v in excess.items() if k not in ("joint", "tip")) < 1e-3, excess
