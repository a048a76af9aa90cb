"""Limits of a motion: each against its formula, and all of them against a dense oracle."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.modes import Mode
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_model.types import frozen
from mhsb_model.workspace import compute_joint_excess
from mhsb_planner.motion.limits.joint_range import JOINT_LIMIT
from mhsb_planner.motion.limits.module_budget import MODULE_LIMIT
from mhsb_planner.motion.limits.node_set import NODE_SET_LIMIT
from mhsb_planner.motion.limits.usage import USAGE_LIMIT
from mhsb_planner.motion.s3_limits import compute_position_excess, find_first_violation

FORCES = st.floats(-4000, 4500)
MODES = st.sampled_from(list(Mode))


def hold_schedule(*modes):
    return ModeSchedule(0, [0], [modes])


def ramp(start, end, duration=2.0, points=101):
    """From rest to rest on a straight line in joint space."""
    u = np.linspace(0, 1, points)[:, None]
    dq = np.asarray(end) - start
    return Trajectory(
        0,
        np.rint(u[:, 0] * duration * SECOND_NS).astype(np.int64),
        start + dq * (10 * u**3 - 15 * u**4 + 6 * u**5),
        dq * (30 * u**2 - 60 * u**3 + 30 * u**4) / duration,
        dq * (60 * u - 180 * u**2 + 120 * u**3) / duration**2,
    )


def test_a_motion_within_all_limits_has_no_violation(machine):
    motion = ramp(np.array([0.3, -1.4, -1.0]), [0.35, -1.45, -1.1])
    assert find_first_violation(machine, motion, hold_schedule(1, 1, 1)) is None


def test_leaving_the_node_set_is_seen(slider_crank_machine):
    machine = slider_crank_machine
    motion = ramp(np.array([1.4, 0.0, 0.0]), [1.5, 0.12, 0.15], 20.0)
    assert machine.tip_position(motion.position[-1])[0] < 0
    violation = find_first_violation(machine, motion, hold_schedule(1, 1, 1))
    assert violation.limit == NODE_SET_LIMIT
    assert "workspace" in str(violation)


def test_a_load_above_the_supply_pressure_is_not_lifted_in_normal_mode(slider_crank_machine):
    machine = slider_crank_machine
    motion = ramp(np.array([0.0, 0.0, 0.0]), [0.05, 0.0, 0.0], 2.0)
    refused = find_first_violation(machine, motion, hold_schedule(0, 0, 0))
    assert refused.limit == USAGE_LIMIT
    assert refused.amount == np.inf
    assert find_first_violation(machine, motion, hold_schedule(1, 0, 0)) is None


def test_modules_beyond_the_budget_are_counted(machine):
    motion = ramp(np.array([0.3, -1.4, -1.0]), [0.35, -1.45, -1.1])
    violation = find_first_violation(machine, motion, hold_schedule(2, 2, 1))
    assert (violation.limit, violation.amount) == (MODULE_LIMIT, 1.0)


def test_the_excess_of_postures_agrees_with_joint_limits_and_tip_positions(slider_crank_machine):
    machine, random = slider_crank_machine, np.random.default_rng(4)
    a = machine.arrays
    for _ in range(50):
        q = frozen(random.uniform(a.joint_min - 0.05, a.joint_max + 0.05, (3, 3)))
        x, z = machine.tip_positions(q).T
        radius = np.hypot(x, z)
        away = max((a.min_x - x).max(), a.min_radius - radius.min(), radius.max() - a.max_radius)
        found = compute_position_excess(a, q)
        np.testing.assert_allclose(found, (compute_joint_excess(a, q).max(), away), atol=1e-14)


@settings(max_examples=60)
@given(st.integers(0, 2**32))
def test_violations_agree_with_a_dense_oracle(machine, worst, seed):
    random = np.random.default_rng(seed)
    limits = machine.arrays
    start = random.uniform(limits.joint_min, limits.joint_max)
    end = np.clip(
        start + random.uniform(-0.3, 0.3, 3), limits.joint_min - 0.01, limits.joint_max + 0.01
    )
    motion = ramp(start, end, random.uniform(1, 6))
    modes = machine.patterns[random.integers(len(machine.patterns))]
    schedule = hold_schedule(*modes)
    measured = worst(motion, schedule)
    found = find_first_violation(machine, motion, schedule)
    broken = {name for name, excess in measured.items() if excess > 1e-6}
    assert (found is not None) == bool(broken), (found, measured)
    if found is not None:
        kinds = {JOINT_LIMIT: {"joint"}, NODE_SET_LIMIT: {"tip"}}
        other = {"main_pump", "servo_pump", "valve", "pressure"}
        assert kinds.get(found.limit, other) & broken
