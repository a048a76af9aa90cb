"""Ramps against the convolution they are defined by."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from mhsb_planner.motion.s3_ramps import (
    RAMP_LIMIT_SHARE,
    Ramp,
    compute_shortest_ramp,
    evaluate_ramp,
    find_ramp_time,
    round_up_to_time_step,
)

TIMES = st.tuples(st.floats(0.001, 0.5), st.floats(0.001, 0.5)).map(sorted)


def kernel_of(rise, blend, t):
    """box(T₁) * box(T₂): how much of the one lies within the other, centred at t."""
    overlap = min(t, blend) - max(0.0, t - rise)
    return max(0.0, overlap) / (rise * blend)


@given(TIMES, st.floats(-0.2, 1.2))
def test_a_ramp_is_the_convolution_of_two_boxes_integrated_twice(times, share):
    blend, rise = times
    t = share * (rise + blend)
    way, speed, rate = evaluate_ramp(rise, blend, t)
    assert rate == pytest.approx(kernel_of(rise, blend, t), rel=1e-9, abs=1e-9)
    corners = [c for c in (0.0, blend, rise, rise + blend) if c < t]
    points = [*corners, t]

    def piecewise(f):
        pieces = pairwise(points) if t > 0 else ()
        return sum(quad(f, a, b, epsabs=1e-13)[0] for a, b in pieces)

    assert speed == pytest.approx(piecewise(lambda s: kernel_of(rise, blend, s)), abs=1e-9)
    moments = piecewise(lambda s: (t - s) * kernel_of(rise, blend, s))
    assert way == pytest.approx(moments, abs=1e-9)


@given(TIMES, st.floats(1e-3, 0.999))
def test_the_time_at_which_speed_and_acceleration_have_a_ratio_is_found(times, share):
    blend, rise = times
    t = share * (rise + blend)
    _, speed, rate = evaluate_ramp(rise, blend, t)
    assert find_ramp_time(rise, blend, speed / rate) == pytest.approx(t, rel=1e-6, abs=1e-9)


def test_the_shortest_ramp_to_v_max_has_its_share_of_acceleration_and_jerk(machine):
    ramp, m = compute_shortest_ramp(machine), machine.arrays
    assert ramp == pytest.approx((0.12, 0.05))
    fastest = m.max_piston_speed.max()
    acceleration = fastest / ramp.rise
    assert acceleration == pytest.approx(RAMP_LIMIT_SHARE * m.max_piston_acceleration, rel=0.02)
    jerk = fastest / (ramp.rise * ramp.blend)
    assert jerk == pytest.approx(RAMP_LIMIT_SHARE * m.max_piston_jerk, rel=0.03)
    assert jerk <= RAMP_LIMIT_SHARE * m.max_piston_jerk


def test_ramps_are_those_of_the_fastest_piston(machine):
    slower = machine.with_values({"joints.1.actuator.max_piston_speed": 0.002})
    assert compute_shortest_ramp(slower) == compute_shortest_ramp(machine)
    own = {f"joints.{j}.actuator.max_piston_speed": 0.004 + 0.001 * j for j in range(3)}
    slowed = machine.changed(max_piston_speed=0.006)
    assert compute_shortest_ramp(machine.with_values(own)) == compute_shortest_ramp(slowed)


def test_a_slow_machine_never_reaches_its_largest_acceleration(machine):
    ramp, jerk = compute_shortest_ramp(machine.changed(max_piston_speed=0.002)), 2.0
    assert ramp.rise == ramp.blend == pytest.approx(np.sqrt(0.002 / jerk), abs=1e-3)


def test_times_are_whole_ticks_and_slower_ramps_are_slower():
    assert round_up_to_time_step(0.0101) == pytest.approx(0.011)
    assert round_up_to_time_step(0.011) == pytest.approx(0.011)
    slower = Ramp(0.08, 0.038).scale(1.0, 3.0)
    assert slower == pytest.approx((0.114, 0.08))
