"""The registry of limits: what it lists is what it measures."""

import numpy as np

from mhsb_planner.motion.limits.limit import LimitInputs
from mhsb_planner.motion.limits.registry import STATE_LIMITS
from mhsb_planner.motion.motion_profile import compute_motion_profile
from mhsb_planner.motion.s3_limits import LimitValues


def test_all_limits_are_measured_in_the_order_of_the_registry(machine):
    m, random = machine.arrays, np.random.default_rng(5)
    q = random.uniform(m.joint_min, m.joint_max, (20, 3))
    profile = compute_motion_profile(machine, q, random.normal(0, 0.1, (20, 3)), 0.0 * q + 0.5)
    modes = machine.patterns[random.integers(len(machine.patterns), size=20)]
    values = LimitValues.from_profile(machine, profile, modes)
    for k in range(20):
        p = profile
        rows = p.position[k], p.speed[k], p.force[k], p.inertia[k], p.tip[k], modes[k]
        state = LimitInputs(*rows, np.empty(3))
        for limit in STATE_LIMITS:
            assert values.of(limit)[k] == limit.measure.py_func(m, state), limit.name
