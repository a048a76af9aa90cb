"""Contacts of trajectories with obstacles, against clearances at closely spaced instants."""

import numpy as np
import pytest

from mhsb_model.obstacles.clearance import clearances
from mhsb_model.obstacles.zones import Zones
from mhsb_model.trajectory import SECOND_NS, Trajectory, standstill
from mhsb_planner.motion.s3_clearance import CLOSEST_LOOKS, START_LEEWAY, find_first_contact

SPACING_NS = 20_000_000
ZONES = Zones(boxes=((0.7, -0.1, 0.9, 0.1),), tip_circles=((0.4, 0.6, 0.1),))


def swing(start, end, seconds):
    """From rest to rest, q̈ = 0 at both ends, points 20 ms apart."""
    offset = np.arange(0, round(seconds * SECOND_NS) + 1, SPACING_NS)
    u = (offset / offset[-1])[:, None]
    turn, t = end - start, offset[-1] / SECOND_NS
    return Trajectory(
        0,
        offset,
        start + turn * (10 * u**3 - 15 * u**4 + 6 * u**5),
        turn * (30 * u**2 - 60 * u**3 + 30 * u**4) / t,
        turn * (60 * u - 180 * u**2 + 120 * u**3) / t**2,
    )


def sampled(machine, trajectory, spacing_ns=200_000):
    at = np.arange(0, trajectory.duration_ns + 1, spacing_ns)
    postures = trajectory.sample_many(at)[0]
    return at / SECOND_NS, clearances(machine.arrays, machine.obstacles.rows, postures)[0]


def test_a_contact_is_told_where_sampling_finds_one_and_nowhere_else(machine):
    crowded = machine.changed(zones=ZONES)
    random = np.random.default_rng(0)
    limits = machine.arrays.joint_min, machine.arrays.joint_max
    met = clear = 0
    for _ in range(150):
        start, other = random.uniform(*limits, (2, 3))
        if crowded.clearance(start)[0] < START_LEEWAY:
            continue
        trajectory = swing(start, start + 0.4 * (other - start), random.uniform(1.0, 4.0))
        contact = find_first_contact(crowded, trajectory)
        time, distance = sampled(crowded, trajectory)
        if contact is None:
            assert distance.min() > 0.0
            clear += 1
        else:
            assert distance[time < contact.time - CLOSEST_LOOKS].min(initial=1.0) > 0.0
            near = np.abs(time - contact.time) < 2 * CLOSEST_LOOKS
            assert distance[near].min() < 2e-3  # what the arm moves in a millisecond here
            assert contact.name in crowded.obstacles.names
            met += 1
    assert met > 20
    assert clear > 20


def test_a_fast_swing_does_not_pass_through_a_thin_wall_between_two_instants(machine):
    wall = machine.changed(zones=Zones(tip_boxes=((0.3, 0.0, 1.1, 1e-5),)))
    up, down = np.array([0.4, -0.5, 0.0]), np.array([-0.4, -0.5, 0.0])
    for seconds in np.linspace(0.3, 0.5, 7).round(2):
        assert "box" in find_first_contact(wall, swing(up, down, seconds)).name


def test_an_arm_in_a_zone_may_leave_it_once_and_go_no_deeper(machine):
    q = np.array([0.4, -1.0, 0.2])
    x, z = machine.tip_position(q)
    zone = machine.changed(zones=Zones(tip_boxes=((x - 0.3, z - 0.4, x + 0.02, z + 0.4),)))
    turn = np.append(np.linalg.solve(machine.jacobian(q)[:, :2], [0.1, 0.0]), 0.0)
    out = swing(q, q + turn, 2.0)
    assert find_first_contact(zone, out) is None
    assert find_first_contact(zone, standstill(q)) is None
    deeper = find_first_contact(zone, swing(q, q - turn, 2.0))
    assert deeper.clearance == pytest.approx(-0.02 - START_LEEWAY, abs=1e-3)
    back = swing(q + turn, q, 2.0)
    there_and_back = Trajectory(
        0,
        np.concatenate([out.offset_ns, out.duration_ns + back.offset_ns[1:]]),
        *(
            np.vstack([getattr(out, name), getattr(back, name)[1:]])
            for name in ("position", "velocity", "acceleration")
        ),
    )
    contact = find_first_contact(zone, there_and_back)
    assert contact.time > 2.0
    assert contact.clearance == pytest.approx(0.0, abs=1e-3)


def test_without_obstacles_there_is_no_contact(machine):
    limits = machine.arrays.joint_min, machine.arrays.joint_max
    assert find_first_contact(machine, swing(*limits, 2.0)) is None
