"""Trajectories with their modes: a rest where a motion is too short to switch."""

import numpy as np
import pytest

from mhsb_model.holding import choose_holding_modes
from mhsb_model.modes import Mode
from mhsb_model.trajectory import SECOND_NS, Trajectory, standstill
from mhsb_planner.motion.s4_mode_schedule import ScheduledMotion, StartModes

N, DB = Mode.N, Mode.DB
STRETCHED, FOLDED = np.array([0.2, -0.4, -0.2]), np.array([0.6, -2.2, -0.6])


def short_move(machine, posture, seconds=0.2):
    """From rest to rest, 2 mrad of joint 1 upwards."""
    u = np.linspace(0, 1, 11)[:, None]
    lift = np.array([0.002, 0.0, 0.0])
    return Trajectory(
        0,
        np.round(np.linspace(0, seconds, 11) * SECOND_NS).astype(int),
        posture + lift * (10 * u**3 - 15 * u**4 + 6 * u**5),
        lift * (30 * u**2 - 60 * u**3 + 30 * u**4) / seconds,
        lift * (60 * u - 180 * u**2 + 120 * u**3) / seconds**2,
    )


def test_a_motion_long_enough_for_its_switches_stays_as_it_is(machine):
    motion = short_move(machine, FOLDED)
    made = ScheduledMotion.create(machine, motion, StartModes.create_settled([N, N, N]))
    assert made.trajectory is motion
    assert made.keeps_dwell
    assert made.schedule.end_ns == motion.end_ns


def test_boost_that_has_just_begun_ends_after_a_rest(machine):
    motion = short_move(machine, FOLDED)
    young = StartModes([DB, N, N], [0.0, 9.0, 9.0])
    made = ScheduledMotion.create(machine, motion, young)
    assert made.keeps_dwell
    assert made.trajectory.end_ns > motion.end_ns
    rest = made.trajectory.sample(motion.end_ns + 1)
    assert not rest.velocity.any()
    assert rest.position == pytest.approx(motion.position[-1], abs=0)
    assert np.max(np.diff(made.trajectory.offset_ns)) <= 20_000_000
    assert made.schedule.find_last_switches(made.schedule.end_ns)[0] >= 0.3 * SECOND_NS
    assert made.schedule.modes[-1].tolist() == [N, N, N]


def test_an_arm_at_rest_keeps_boost_for_its_least_time(machine):
    young = StartModes([DB, N, N], [0.1, 9.0, 9.0])
    made = ScheduledMotion.create(machine, standstill(FOLDED), young)
    assert made.keeps_dwell
    assert made.schedule.modes_at(int(0.19 * SECOND_NS)).tolist() == [DB, N, N]
    held = choose_holding_modes(machine, machine.piston_forces(FOLDED))
    assert made.schedule.modes[-1].tolist() == held.tolist()
