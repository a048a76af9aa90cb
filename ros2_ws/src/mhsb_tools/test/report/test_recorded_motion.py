"""The recorded motion as one curve, and what cannot be one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mhsb_tools.recording.bag_format import BagError
from mhsb_tools.report.recorded_motion import (
    compute_tip_motion,
    cut_trajectory,
    join_modes,
    join_references,
)


def test_between_two_references_the_curve_is_that_of_the_plan(run):
    plan = run.recording.trajectories[0]
    times = plan.stamp_ns + np.random.default_rng(3).integers(0, plan.duration_ns, 200)
    for mine, planned in zip(
        run.reference.sample_many(times)[:2], plan.sample_many(times)[:2], strict=True
    ):
        np.testing.assert_allclose(mine, planned, atol=1e-9)


def test_a_part_of_a_curve_is_the_curve(run):
    begin, end = run.reference.stamp_ns + 1_503_000_000, run.reference.stamp_ns + 4_707_000_000
    piece = cut_trajectory(run.reference, begin, end)
    assert (piece.stamp_ns, piece.end_ns) == (begin, end)
    times = np.linspace(begin, end, 300).astype(np.int64)
    np.testing.assert_allclose(
        piece.sample_many(times)[0], run.reference.sample_many(times)[0], atol=1e-12
    )


def test_motion_lasts_from_the_first_to_the_last_moment_of_it(run):
    moving = (run.tip.time_ns[run.tip.moving] - run.reference.stamp_ns) / 1e9
    assert moving[0] == pytest.approx(1.0, abs=0.02)
    assert moving[-1] == pytest.approx(10.0, abs=0.02)
    assert np.all(np.diff(moving) < 0.011)  # the rest in between belongs to it


def test_measurements_beyond_the_references_are_left_out(run):
    references = run.recording.references
    kept = slice(100, 300)
    fewer = replace(
        references,
        time_ns=references.time_ns[kept],
        position=references.position[kept],
        velocity=references.velocity[kept],
        acceleration=references.acceleration[kept],
    )
    recording = replace(run.recording, references=fewer)
    tip = compute_tip_motion(recording, run.machine, join_references(recording))
    np.testing.assert_array_equal(tip.time_ns, references.time_ns[kept])


def test_a_clock_that_runs_backwards_is_refused(run):
    references = run.recording.references
    recording = replace(
        run.recording, references=replace(references, time_ns=references.time_ns[::-1])
    )
    with pytest.raises(BagError, match="time runs backwards in the recording"):
        join_references(recording)


def test_a_recording_without_a_stream_is_refused(run):
    empty = np.zeros((0, 3))
    none = replace(
        run.recording.references,
        time_ns=np.zeros(0, np.int64),
        position=empty,
        velocity=empty,
        acceleration=empty,
    )
    with pytest.raises(BagError, match="has no references"):
        join_references(replace(run.recording, references=none))
    with pytest.raises(BagError, match="has no modes"):
        join_modes(replace(run.recording, mode_time_ns=np.zeros(0, np.int64)))


def test_of_modes_recorded_at_one_time_the_last_is_in_force(run):
    recording = replace(
        run.recording,
        mode_time_ns=np.array([5, 9, 9, 12]),
        modes=np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 0, 0]], np.uint8),
    )
    schedule = join_modes(recording)
    assert (schedule.stamp_ns, schedule.offset_ns.tolist()) == (5, [0, 4])
    assert schedule.modes.tolist() == [[0, 0, 0], [2, 0, 0]]
