import numpy as np
from scipy.integrate import solve_ivp

from mhsb_sim.servo.servo_pumps import coasting_limit, coasting_volumes


def test_a_coasting_pump_delivers_the_integral_of_its_lag_and_delay() -> None:
    lag, delay = 0.02, 4e-3
    time = np.linspace(0.0, 0.1, 9)
    flows = solve_ivp(
        lambda t, y: [y[1], -y[1] / lag if t > delay else 0.0],
        (0.0, time[-1]), [0.0, 1.0], t_eval=time, max_step=2e-4,
    )  # fmt: skip
    np.testing.assert_allclose(coasting_volumes(lag, delay, time), flows.y[0], rtol=2e-3)


def test_what_may_not_be_drawn_after_all_lowers_the_flow_from_which_a_pump_can_be_stopped() -> None:
    spacing, drawn, capacity = 0.04, 6e-6, 2e-14
    volume = drawn * spacing * np.arange(6)
    points = np.concatenate([np.arange(4) / 4, np.arange(1, 6)])
    coasting = coasting_volumes(0.02, 0.0, spacing * points)
    limits = [
        coasting_limit(volume, coasting, capacity, 1e6, 1e6, doubt, spacing)
        for doubt in (0.0, 1e-6, 2e-6)
    ]
    assert limits[0] > drawn
    assert np.all(np.diff(limits) < 0.0)
