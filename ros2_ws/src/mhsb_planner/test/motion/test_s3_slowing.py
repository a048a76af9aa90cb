"""Slowing of the pieces of a motion in which a limit is broken."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from mhsb_model.trajectory import MotionState
from mhsb_planner.motion import s3_candidates, s3_trajectory
from mhsb_planner.motion.s3_candidates import FitRules
from mhsb_planner.motion.s3_slowing import MIN_PIECE_FACTOR, spread_over_steps
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
