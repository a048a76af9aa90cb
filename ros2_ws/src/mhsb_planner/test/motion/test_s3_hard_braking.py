"""Brakings along a path that are ever harder, against dense sampling of cylinder lengths."""

import numpy as np
import pytest

from mhsb_model.braking import brake_along
from mhsb_model.trajectory import SECOND_NS, MotionState
from mhsb_planner.motion.s3_candidates import FitRules
from mhsb_planner.motion.s3_hard_braking import iterate_harder_brakings
from mhsb_planner.planner import Planner, PlanOptions

STEP_NS = 2_000_000
GOALS = ((0.55, 0.60), (0.80, -0.30))


@pytest.fixture(scope="module", params=GOALS)
def motion(request, machine, table):
    """A motion made of ramps, which itself keeps the machine's acceleration and jerk."""
    start = MotionState.at_rest(np.array(machine.config.simulation.start_posture))
    options = PlanOptions(planner="integrated", trajectory=FitRules.create_following().trajectory)
    return Planner(machine, table).plan(request.param, start, options=options).motion.trajectory


@pytest.fixture(params=[0.15, 0.5, 0.75, 0.9])
def brakings(request, machine, motion):
    """The time at which the motion is left [ns], and all brakings from there."""
    at_ns = round(request.param * motion.duration_ns)
    return at_ns, list(iterate_harder_brakings(machine, motion, at_ns))


def accelerations(machine, motion):
    """Of the pistons every 2 ms, from second differences of their lengths [m/s²]."""
    at_ns = motion.stamp_ns + np.arange(0, motion.duration_ns, STEP_NS)
    lengths = np.array([machine.cylinder_lengths(q) for q in motion.sample_many(at_ns)[0]])
    return np.diff(lengths, n=2, axis=0) / (STEP_NS / SECOND_NS) ** 2


def test_hard_braking_keeps_the_acceleration_and_the_jerk_of_the_machine(machine, brakings):
    _, found = brakings
    assert found
    for braking in found:
        acceleration = accelerations(machine, braking)
        jerk = np.diff(acceleration, axis=0) / (STEP_NS / SECOND_NS)
        assert np.abs(acceleration).max() <= 1.02 * machine.arrays.max_piston_acceleration
        assert np.abs(jerk).max() <= 1.1 * machine.arrays.max_piston_jerk


def test_hard_braking_begins_with_the_state_of_the_motion_and_rests_on_its_path(motion, brakings):
    at_ns, found = brakings
    state = motion.sample(at_ns)
    way = motion.sample_many(np.arange(at_ns, motion.end_ns, 100_000))[0]
    for braking in found:
        assert braking.stamp_ns == at_ns
        assert braking.position[0] == pytest.approx(state.position, abs=1e-12)
        assert braking.velocity[0] == pytest.approx(state.velocity, abs=1e-12)
        assert braking.acceleration[0] == pytest.approx(state.acceleration, abs=1e-9)
        assert not braking.velocity[-1].any()
        assert not braking.acceleration[-1].any()
        for q in braking.sample_many(at_ns + np.arange(0, braking.duration_ns, 5_000_000))[0]:
            assert np.abs(way - q).max(axis=1).min() < 1e-4


def test_each_braking_rests_sooner_than_the_one_before_and_than_a_planned_stop(
    machine, motion, brakings
):
    at_ns, found = brakings
    end = motion.position[-1]
    left = [np.abs(end - braking.position[-1]).max() for braking in found]
    assert left == sorted(left)
    stop = brake_along(machine, motion, at_ns)
    assert left[-1] > np.abs(end - stop.position[-1]).max()


def test_a_motion_that_takes_all_that_is_allowed_already_is_braked_with_half_as_much_on_top(
    machine, motion
):
    for at_ns in np.linspace(0.02, 0.98, 25) * motion.duration_ns:
        for braking in iterate_harder_brakings(machine, motion, round(at_ns)):
            acceleration = accelerations(machine, braking)
            jerk = np.diff(acceleration, axis=0) / (STEP_NS / SECOND_NS)
            assert np.abs(acceleration).max() <= 1.55 * machine.arrays.max_piston_acceleration
            assert np.abs(jerk).max() <= 1.65 * machine.arrays.max_piston_jerk


def test_a_motion_that_rests_or_is_over_is_not_braked(machine, motion):
    assert not list(iterate_harder_brakings(machine, motion, motion.stamp_ns))
    assert not list(iterate_harder_brakings(machine, motion, motion.end_ns))
    assert not list(iterate_harder_brakings(machine, motion, motion.end_ns + SECOND_NS))
