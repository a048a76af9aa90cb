import numpy as np
from scipy.integrate import solve_ivp

from mhsb_control.coasting import compute_coasting_limit, compute_coasting_volumes
from mhsb_model.types import FloatArray


def volumes_at(lag: float, delay: float, later: float, time: FloatArray) -> FloatArray:
    volumes = np.empty(len(time))
    compute_coasting_volumes(lag, delay, later, time, volumes)
    return volumes


def test_a_coasting_pump_delivers_the_integral_of_its_lag_from_its_delay_on() -> None:
    lag, delay, later = 0.02, 3e-3, 4e-3
    time = np.linspace(delay, 0.1, 9)
    flows = solve_ivp(
        lambda t, y: [y[1], -y[1] / lag if t > delay + later else 0.0],
        (delay, time[-1]), [0.0, 1.0], t_eval=time, max_step=2e-4,
    )  # fmt: skip
    found = volumes_at(lag, delay, later, time)
    np.testing.assert_allclose(found, flows.y[0], rtol=2e-3, atol=1e-12)
    np.testing.assert_array_equal(volumes_at(lag, delay, later, np.array([0.0, delay])), 0.0)


def test_what_may_not_be_drawn_after_all_or_is_on_its_way_lowers_the_flow_that_can_be_stopped() -> (
    None
):
    spacing, drawn, capacity = 0.04, 6e-6, 2e-14
    volume = drawn * spacing * np.array([1, 1, 2, 3, 4, 5])
    points = np.concatenate([np.arange(4) / 4, np.arange(1, 6)])
    coasting = volumes_at(0.02, 0.0, 0.0, spacing * points)

    def limit(pending: float, doubt: float) -> float:
        return float(
            compute_coasting_limit(volume, coasting, capacity, (1e6, 1e6), pending, doubt, spacing)
        )

    assert limit(0.0, 0.0) > drawn
    assert limit(0.0, 2e-6) < limit(0.0, 1e-6) < limit(0.0, 0.0)
    assert limit(1e-8, 0.0) < limit(0.0, 0.0)
