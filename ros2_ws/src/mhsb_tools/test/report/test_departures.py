"""Where one plan leaves another, on the story's recording and on hand-overs of the planner's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from benchmarks.departures import find_branch_time, find_branch_times

from mhsb_model.trajectory import Trajectory, quintic_hermite
from mhsb_tools.recording.recording import TimedValue

STEP_NS = 20_000_000
REST = np.zeros(3)


def curve(start, end, stamp_ns=0, hold=0):
    """From rest to rest in 2 s, after holding for so many points."""
    q = [np.array(values) for values in (start, end)]
    time = np.clip(np.arange(hold + 101) - hold, 0, 100)[:, None] * STEP_NS / 1e9
    states = quintic_hermite(time, np.array([[2.0]]), (q[0], REST, REST), (q[1], REST, REST))
    return Trajectory(stamp_ns, np.arange(hold + 101) * STEP_NS, *states)


def test_from_rest_a_plan_leaves_where_it_begins_to_move():
    held = Trajectory(0, [0], [[0.1, 0.2, 0.3]], [REST], [REST])
    new = curve((0.1, 0.2, 0.3), (0.4, 0.2, 0.3), stamp_ns=7, hold=5)
    assert find_branch_time(held, new) == 7 + 5 * STEP_NS


def test_in_motion_a_plan_leaves_after_the_points_that_it_repeats():
    old = curve((0.1, 0.2, 0.3), (0.4, 0.2, 0.3))
    repeated, change = np.arange(20, 26), old.sample(25 * STEP_NS)
    away = quintic_hermite(
        np.arange(1, 51)[:, None] * STEP_NS / 1e9,
        np.array([[1.0]]),
        (change.position, change.velocity, change.acceleration),
        (np.array([0.0, 0.0, 0.0]), REST, REST),
    )
    kept = (values[repeated] for values in (old.position, old.velocity, old.acceleration))
    states = (np.vstack(both) for both in zip(kept, away, strict=True))
    new = Trajectory(20 * STEP_NS, np.arange(56) * STEP_NS, *states)
    assert find_branch_time(old, new) == 25 * STEP_NS


def test_a_plan_that_is_the_old_one_to_its_end_never_leaves_it():
    old = curve((0.1, 0.2, 0.3), (0.4, 0.2, 0.3))
    assert find_branch_time(old, old) == old.end_ns


def test_departures_of_a_recording_are_those_of_plans_that_were_executed(run):
    first, second, third = run.recording.trajectories
    assert find_branch_times(run.recording) == {
        first.stamp_ns: first.stamp_ns,
        second.stamp_ns: second.end_ns,  # goes on along the same curve
        third.stamp_ns: third.stamp_ns,
    }
    held = replace(run.recording, plans_in_force=(TimedValue(0, 0),))
    assert find_branch_times(held) == {}
