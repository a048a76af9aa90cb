import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mhsb_control.draw_estimate import (
    DrawSettings,
    MeasuredLine,
    build_draw_observers,
    compute_draw_shortfall,
    update_draw_observer,
)
from mhsb_model.records import create_record

STEP, CAPACITY, TARGET = 1e-3, 2e-14, 6e6
SETTINGS = DrawSettings()
RECORD = create_record(SETTINGS)[0]


def observed(commanded: float, passes: float, seconds: float, alone: bool = True) -> float:
    """Return the observed shortfall of a line whose valve passes a share of what is commanded."""
    draws = build_draw_observers(1)
    draw, pressure = draws[0], TARGET
    draw["pressure"], draw["delayed_command"] = pressure, commanded
    for _ in range(round(seconds / STEP)):
        supplied = passes * commanded + CAPACITY * 1e5 / STEP  # rises by 0.1 MPa a step
        pressure += 1e5
        line = MeasuredLine(pressure, supplied, alone)
        update_draw_observer(draw, line, commanded, CAPACITY, 0.0, STEP, RECORD)
    draw["pressure"] = TARGET
    return compute_draw_shortfall(draw, TARGET, RECORD)


def test_what_a_valve_does_not_pass_is_told_apart_from_what_compresses_the_line() -> None:
    commanded = 4e-6
    for seconds in (0.01, 0.03, 0.2):

        def rate(t: float, d: float) -> float:
            return (0.4 * commanded - d) / SETTINGS.observation_delay

        exact = solve_ivp(rate, (0.0, seconds), [0.0], rtol=1e-8, atol=1e-16).y[0, -1]
        assert observed(commanded, 0.6, seconds) == pytest.approx(exact, rel=0.04)


def test_a_line_that_draws_what_it_is_told_or_more_draws_nothing_less() -> None:
    assert observed(4e-6, 1.0, 0.2) == pytest.approx(0.0, abs=1e-12)
    assert observed(4e-6, 1.3, 0.2) == 0.0


def test_a_line_that_others_feed_too_is_not_judged() -> None:
    assert observed(4e-6, 0.6, 0.2, alone=False) == 0.0


def test_a_line_far_below_its_target_is_not_judged_as_it_gives_what_there_is() -> None:
    draw = build_draw_observers(1)[0]
    draw["excess_flow"] = -1e-6
    found = []
    for pressure in (
        TARGET + 1e6,
        TARGET,
        TARGET - 0.5 * SETTINGS.pressure_shortfall_scale,
        TARGET - SETTINGS.pressure_shortfall_scale,
        TARGET - 1e6,
    ):
        draw["pressure"] = pressure
        found.append(compute_draw_shortfall(draw, TARGET, RECORD))
    np.testing.assert_allclose(found, [1e-6, 1e-6, 0.5e-6, 0.0, 0.0], atol=1e-12)
