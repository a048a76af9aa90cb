import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from mhsb_model.circuit import elements
from mhsb_model.circuit.quantities import CylinderConstants
from mhsb_model.records import create_records

DP_LAMINAR = 5e4
drops = st.floats(-2e7, 2e7)


def slope_by_differences(flow: Callable[[float], float], at: float) -> float:
    step = 1.0
    return (flow(at + step) - flow(at - step)) / (2 * step)


@given(drops)
def test_the_orifice_follows_its_equation_and_slope(drop: float) -> None:
    k = 1.8e-8
    flow, slope = elements.compute_orifice_flow(k, drop, DP_LAMINAR)
    assert flow == pytest.approx(k * drop / (drop**2 + DP_LAMINAR**2) ** 0.25, rel=1e-12)
    numeric = slope_by_differences(
        lambda p: elements.compute_orifice_flow(k, p, DP_LAMINAR)[0], drop
    )
    assert slope == pytest.approx(numeric, rel=1e-5)


def test_the_orifice_gives_its_rated_flow_and_is_laminar_at_zero() -> None:
    rated = 3.5e6
    flow, _ = elements.compute_orifice_flow(3.333e-5 / math.sqrt(rated), rated, DP_LAMINAR)
    assert flow == pytest.approx(3.333e-5, rel=1e-4)
    _, slope = elements.compute_orifice_flow(1.0, 0.0, DP_LAMINAR)
    assert slope == pytest.approx(1.0 / math.sqrt(DP_LAMINAR))


@given(drops)
def test_a_check_valve_is_an_orifice_forwards_and_tight_backwards(drop: float) -> None:
    assume(abs(drop) > 1e-9)
    flow, slope = elements.compute_check_valve_flow(1e-7, drop, DP_LAMINAR)
    if drop <= 0:
        assert (flow, slope) == (0.0, 0.0)
        return
    forwards, tangent = elements.compute_orifice_flow(1e-7, drop, DP_LAMINAR)
    assert flow == forwards
    assert slope >= tangent * (1.0 - 1e-9)
    assert slope * drop == pytest.approx(flow)


@given(drops)
def test_a_relief_valve_opens_above_its_setting(drop: float) -> None:
    setting, gain = 1.4e7, 1e-11
    assume(abs(drop - setting) > 2.0)
    flow, slope = elements.compute_relief_valve_flow(gain, drop, setting)
    assert flow == pytest.approx(gain * max(0.0, drop - setting))
    numeric = slope_by_differences(
        lambda p: elements.compute_relief_valve_flow(gain, p, setting)[0], drop
    )
    assert slope == pytest.approx(numeric, rel=1e-5, abs=1e-15)


@given(st.floats(3.9e6, 4.1e6))
def test_the_main_pump_keeps_its_pressure_within_its_flow(pressure: float) -> None:
    largest, setting, droop = 3.3e-5, 4e6, 2e4
    assume(min(abs(pressure - setting), abs(pressure - setting + droop)) > 2.0)
    flow, slope = elements.compute_main_pump_flow(largest, setting, droop, pressure)
    share = np.clip((setting - pressure) / droop, 0.0, 1.0)
    assert flow == pytest.approx(largest * share)
    numeric = slope_by_differences(
        lambda p: elements.compute_main_pump_flow(largest, setting, droop, p)[0], pressure
    )
    assert slope == pytest.approx(-numeric, rel=1e-5, abs=1e-15)


def test_the_servo_pump_follows_with_its_lag_within_slew_and_flow() -> None:
    lag, dt = 0.02, 5e-4
    decay = math.exp(-dt / lag)
    flow = 0.0
    for _ in range(40):
        flow = elements.advance_servo_pump_flow(flow, 2e-6, 5e-6, decay, 1.0)
    assert flow == pytest.approx(2e-6 * (1 - math.exp(-1.0)), rel=1e-9)
    assert elements.advance_servo_pump_flow(0.0, 5e-6, 5e-6, decay, 1e-8) == pytest.approx(1e-8)
    for _ in range(2000):
        flow = elements.advance_servo_pump_flow(flow, 1.0, 5e-6, decay, 1.0)
    assert flow == pytest.approx(5e-6)
    for _ in range(2000):
        flow = elements.advance_servo_pump_flow(flow, -1.0, 5e-6, decay, 1.0)
    assert flow == pytest.approx(0.0, abs=1e-15)


@given(st.floats(20.0, 300.0), st.floats(0.1, 2.5), st.floats(1e-4, 2e-3))
def test_the_spool_moves_as_the_matrix_exponential_of_its_equation(
    frequency: float, damping: float, dt: float
) -> None:
    omega = 2 * math.pi * frequency
    system = np.array([[0.0, 1.0], [-(omega**2), -2 * damping * omega]])
    found = np.array(elements.compute_spool_transition(frequency, damping, dt)).reshape(2, 2)
    np.testing.assert_allclose(found, expm(system * dt), rtol=1e-7, atol=1e-9)


def test_a_critically_damped_spool_has_the_limit_of_the_formula() -> None:
    omega, dt = 2 * math.pi * 100.0, 5e-4
    system = np.array([[0.0, 1.0], [-(omega**2), -2 * omega]])
    found = np.array(elements.compute_spool_transition(100.0, 1.0, dt)).reshape(2, 2)
    np.testing.assert_allclose(found, expm(system * dt), rtol=1e-7)


def test_a_pump_is_filled_by_its_inlet_pressure_above_the_vapours() -> None:
    vapour, filling = 1e3, 8e4
    pressures = np.linspace(0.0, 1.2e5, 200)
    found = np.array([elements.compute_pump_filling(p, vapour, filling) for p in pressures])
    np.testing.assert_allclose(found[:, 0], np.clip((pressures - vapour) / filling, 0.0, 1.0))
    inside = (found[:, 0] > 0.0) & (found[:, 0] < 1.0)
    np.testing.assert_allclose(found[inside, 1], 1.0 / filling)
    assert not found[~inside, 1].any()


def test_a_pumps_efficiency_falls_with_its_load() -> None:
    full = elements.compute_shaft_power(90.0, 1.0, 0.9, 10.0)
    assert full == pytest.approx(90.0 / 0.9 + 10.0)
    quarter = elements.compute_shaft_power(22.5, 1.0, 0.9, 10.0)
    assert 22.5 / quarter < 90.0 / full
    assert elements.compute_shaft_power(-5.0, 0.0, 0.9, 10.0) == 0.0


@given(st.lists(st.floats(-5e-7, 5e-7), min_size=1, max_size=20))
def test_a_parted_node_keeps_its_oil_and_never_falls_below_vapour_pressure(
    inflows: list[float],
) -> None:
    capacity, vapour, start = 2e-14, 1e3, 4e6
    pressure, cavity = start, 0.0
    for k, inflow in enumerate(inflows):
        pressure, cavity = elements.advance_pressure_and_cavity(
            pressure, cavity, capacity, vapour, inflow
        )
        content = capacity * (start - vapour) + sum(inflows[: k + 1])
        assert pressure >= vapour
        assert cavity >= 0.0
        assert capacity * (pressure - vapour) - cavity == pytest.approx(content, abs=1e-18)
        assert cavity == 0.0 or pressure == vapour


def test_a_spool_with_hysteresis_goes_round_a_loop_as_wide_as_its_play() -> None:
    width, x = 0.04, 0.0
    ends = ((0, 1, 101), (1, -1, 201), (-1, 1, 201))
    there = np.concatenate([np.linspace(*end) for end in ends])
    followed = []
    for command in there:
        x = elements.follow_with_backlash(x, command, width)
        followed.append(x)
    up, down = np.array(followed[301:]), np.array(followed[100:301])
    np.testing.assert_allclose(up[5:] - there[301:][5:], -width / 2, atol=1e-12)
    np.testing.assert_allclose(down[5:] - there[100:301][5:], width / 2, atol=1e-12)
    assert elements.follow_with_backlash(0.3, 0.7, 0.0) == 0.7
    assert math.isnan(elements.follow_with_backlash(0.3, math.nan, width))


@given(st.floats(-1.0, 1.0))
def test_a_valve_follows_its_declared_curve(opening: float) -> None:
    curve = np.array([[0.0, 0.2, 0.7, 1.0, 1.0], [0.0, 0.05, 0.95, 1.0, 1.0]])  # filled up with 1
    expected = math.copysign(np.interp(abs(opening), *curve), opening)
    assert elements.apply_valve_curve(opening, curve) == pytest.approx(expected, abs=1e-15)


@given(drops, st.floats(1e4, 5e6))
def test_a_compensated_edge_passes_no_more_than_at_its_kept_drop(drop: float, kept: float) -> None:
    k = 1.8e-8
    flow, slope = elements.compute_metering_flow(k, drop, DP_LAMINAR, kept)
    assert flow == pytest.approx(
        k * min(drop, kept) / (min(drop, kept) ** 2 + DP_LAMINAR**2) ** 0.25
    )
    assert slope == (0.0 if drop > kept else elements.compute_orifice_flow(k, drop, DP_LAMINAR)[1])
    plain = elements.compute_orifice_flow(k, drop, DP_LAMINAR)
    assert elements.compute_metering_flow(k, drop, DP_LAMINAR, math.inf) == plain


def test_a_valve_with_overlap_opens_beyond_it_and_gives_its_rated_flow_at_full_stroke() -> None:
    assert elements.compute_valve_opening(0.02, 0.03) == 0.0
    assert elements.compute_valve_opening(-0.515, 0.03) == pytest.approx(-0.5)
    assert elements.compute_valve_opening(1.0, 0.03) == 1.0
    assert elements.compute_valve_opening(0.7, 0.0) == 0.7
    assert elements.compute_valve_opening(-0.515, 0.03, 2.0) == pytest.approx(-0.25)
    assert elements.compute_valve_opening(1.0, 0.03, 1.8) == 1.0
    assert math.isnan(elements.compute_valve_opening(math.nan, 0.03))


def test_an_accumulator_takes_what_its_gas_gives_way_to() -> None:
    volume, precharge, exponent = 1e-4, 2e6, 1.4
    assert elements.compute_accumulator_capacity(1.9e6, volume, precharge, exponent) == 0.0
    pressures = np.linspace(2e6, 6e6, 4001)
    capacity = [
        elements.compute_accumulator_capacity(p, volume, precharge, exponent) for p in pressures
    ]
    taken = np.trapezoid(capacity[1:], pressures[1:])
    expected = volume * (1.0 - (2.0 / 6.0) ** (1 / exponent))
    assert taken == pytest.approx(expected, rel=2e-3)


def test_bristles_bend_as_radau_has_their_equation() -> None:
    coulomb, breakaway, stribeck, stiffness = 40.0, 1.6, 2e-3, 2e6

    def speed(t: float) -> float:
        return 4e-3 * math.sin(2 * math.pi * t)

    def rate(t: float, z: np.ndarray) -> np.ndarray:
        v = speed(t)
        sliding = coulomb * (1 + (breakaway - 1) * math.exp(-((v / stribeck) ** 2)))
        return v - stiffness * abs(v) / sliding * z

    dt = 1e-4
    times = np.arange(1, 10001) * dt
    exact = solve_ivp(rate, (0.0, 1.0), [0.0], "Radau", times, rtol=1e-8, atol=1e-13).y[0]
    bend, found = 0.0, []
    for t in times:
        v = speed(t - dt / 2)
        sliding = elements.compute_sliding_friction(coulomb, breakaway, stribeck, v)
        bend = elements.advance_bristle_deflection(bend, v, sliding, stiffness, dt)
        found.append(bend)
    force = stiffness * np.array(found)
    assert np.abs(force - stiffness * exact).max() < 0.5
    assert force.max() > 1.3 * coulomb  # breaks away
    assert abs(force[len(force) // 4]) < 1.1 * coulomb  # slides


def test_a_stuck_piston_springs_back_on_its_bristles() -> None:
    stiffness, bend = 2e6, 0.0
    for v in (1e-4, -1e-4):
        bend = elements.advance_bristle_deflection(bend, v, 60.0, stiffness, 1e-3)
    assert abs(stiffness * bend) < 1e-3


def test_a_switching_valve_closes_the_gap_by_its_time_constant() -> None:
    assert elements.advance_first_order_lag(0.0, 1.0, math.exp(-1.0)) == pytest.approx(
        1 - math.exp(-1)
    )


@pytest.mark.parametrize("swept", [1.0, 0.0])
def test_chambers_hold_their_dead_volume_and_the_swept_one_which_motors_have_not(swept) -> None:
    cylinder = create_records(CylinderConstants, 1)[0]
    cylinder["cap_area"], cylinder["rod_area"] = 5e-4, 3e-4
    cylinder["min_length"], cylinder["max_length"] = 0.3, 0.4
    cylinder["dead_volume"], cylinder["swept_volume_factor"] = 1e-5, swept
    cap, rod = elements.compute_chamber_volumes(cylinder, 0.34)
    assert (cap, rod) == pytest.approx((1e-5 + swept * 2e-5, 1e-5 + swept * 1.8e-5))


@given(st.floats(-0.05, 0.05))
def test_friction_opposes_the_motion(speed: float) -> None:
    force = elements.compute_friction_force(40.0, 2000.0, 1e-3, speed)
    assert force == pytest.approx(40.0 * math.tanh(speed / 1e-3) + 2000.0 * speed)
    assert force * speed >= 0.0
