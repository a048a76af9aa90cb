"""Slowing of the pieces of a motion in which a limit is broken."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from mhsb_model.modes import Mode
from mhsb_model.trajectory import MotionState
from mhsb_planner.motion import s3_candidates, s3_trajectory
from mhsb_planner.motion.limits.limit import Violation
from mhsb_planner.motion.limits.registry import STATE_LIMITS
from mhsb_planner.motion.limits.thrust import THRUST_LIMIT
from mhsb_planner.motion.s3_candidates import FitRules
from mhsb_planner.motion.s3_limits import EndValues, LimitValues
from mhsb_planner.motion.s3_slowing import (
    MIN_PIECE_FACTOR,
    PIECE_THRUST_STRETCH,
    THRUST_STRETCH,
    compute_needed_factors,
    spread_over_steps,
)
from mhsb_planner.motion.s3_trajectory import fit_trajectory
from mhsb_planner.motion.s4_mode_schedule import StartModes


@given(
    st.lists(st.floats(0.05, 2.0), min_size=1, max_size=8),
    st.lists(st.floats(0.2, 3.0), min_size=1, max_size=40),
    st.booleans(),
)
def test_both_steps_at_a_node_get_the_largest_factor_of_the_intervals_nearest_to_it(
    spans, needed, slows_pieces
):
    node_time = np.concatenate([[0.0], np.cumsum(spans)])
    time = np.linspace(0.0, node_time[-1], len(needed) + 1)
    expected = np.ones(len(spans))
    for middle, factor in zip(0.5 * (time[:-1] + time[1:]), needed, strict=True):
        distance = np.abs(node_time - middle)
        nearest, second = np.sort(distance)[:2]
        assume(second - nearest > 1e-9)
        node = int(np.argmin(distance))
        expected[max(node - 1, 0) : node + 1] = np.maximum(
            expected[max(node - 1, 0) : node + 1], factor
        )
    if not slows_pieces or max(needed) <= MIN_PIECE_FACTOR:
        expected[:] = max(needed)
    factor = spread_over_steps(np.array(needed), time, node_time, slows_pieces)
    assert factor == pytest.approx(expected)


@pytest.mark.parametrize("seed", [11, 12, 13])
def test_a_path_that_is_too_fast_in_one_step_is_slowed_there_alone(
    machine, walk, seed, monkeypatch
):
    path = walk(np.random.default_rng(seed), 8)
    hurried = path.duration.copy()
    hurried[4] /= 3.0
    path = replace(path, duration=hurried)
    start, rules = MotionState.at_rest(path.posture[0]), FitRules.create_following()
    modes = StartModes.create_settled(path.start_modes)
    scales = []
    curve = s3_candidates.compute_followed_path

    def recorded(machine, path, slower, coast, scale, **options):
        scales.append(np.broadcast_to(scale, path.steps))
        return curve(machine, path, slower, coast, scale, **options)

    monkeypatch.setattr(s3_candidates, "compute_followed_path", recorded)
    motion = fit_trajectory(machine, path, start, modes, None, rules)
    assert motion.method == s3_trajectory.FitMethod.RAMPED
    assert scales[-1][4] > 1.5
    assert np.all(scales[-1][[0, 1, 2, 6, 7]] <= MIN_PIECE_FACTOR)
    assert motion.stretch == pytest.approx(np.sum(scales[-1] * hurried) / np.sum(hurried))


@pytest.mark.parametrize("slows_pieces", [True, False])
def test_intervals_in_which_pressure_lacks_need_the_factor_for_it_and_no_others(slows_pieces):
    thrust = np.zeros((len(STATE_LIMITS), 6))
    thrust[STATE_LIMITS.index(THRUST_LIMIT)] = [0.2, 1.1, 0.9, 1.0, 0.3, 0.1]
    ends = EndValues(
        LimitValues(thrust), LimitValues(0.5 * thrust), np.zeros((6, 3), np.uint8), np.zeros(6)
    )
    violation, time = Violation(THRUST_LIMIT, 0.45, 0.01), np.linspace(0.0, 0.6, 7)
    needed = compute_needed_factors(violation, ends, np.full(6, 0.8), time, slows_pieces)
    stretch = PIECE_THRUST_STRETCH if slows_pieces else THRUST_STRETCH
    assert needed == pytest.approx([1.0, stretch, 1.0, 1.0, stretch, 1.0])


def test_the_arm_stands_still_before_a_step_in_which_a_boost_begins(machine, walk):
    path = walk(np.random.default_rng(5), 6)
    modes = np.zeros_like(path.modes)
    modes[3:, 1] = Mode.DB
    path, start = replace(path, modes=modes), MotionState.at_rest(path.posture[0])
    settled = StartModes.create_settled(path.start_modes)
    tried = list(
        s3_candidates.iterate_candidates(
            machine, path, start, None, None, settled, FitRules.create_following()
        )
    )
    [resting] = [each for each in tried if each.name.startswith("resting before boost")]
    assert resting is tried[-2]  # the last one rests at every node
    assert resting.path.steps == path.steps + 1
    curve = resting.curve_at(np.ones(resting.path.steps), 1.0)
    q, qd, _ = curve.sample(np.array([curve.node_time[3:5].mean()]))
    assert q[0] == pytest.approx(path.posture[3], abs=1e-9)
    assert qd[0] == pytest.approx(np.zeros(3), abs=1e-9)
