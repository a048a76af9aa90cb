import numpy as np
import pytest

from mhsb_model.machine import Machine
from mhsb_sim.circuit.constants import cylinders_of
from mhsb_sim.servo.leakage_estimate import DEVIATION, WINDOW, balance, leaks_of

STEP, CAPACITY, LEAKAGE = 1e-3, 2e-14, 3e-6


@pytest.mark.parametrize("speed", [0.0, 0.008, -0.008])
@pytest.mark.parametrize("share", [0.5, 1.4])
def test_it_is_what_the_pump_delivers_beyond_piston_and_compression(
    machine: Machine, speed: float, share: float
) -> None:
    cylinder, leak = cylinders_of(machine)[0], leaks_of(1)[0]
    area = cylinder["cap_area"] if speed > 0 else cylinder["rod_area"]
    rate = 1e6  # Pa/s
    flow = share * LEAKAGE + area * abs(speed) + CAPACITY * rate
    for k in range(20 * (WINDOW + 1)):
        time = k * STEP
        balance(
            leak, True, flow, LEAKAGE, 6e6 + rate * time, 0.4 + speed * time, cylinder, CAPACITY,
            STEP,
        )  # fmt: skip
    assert leak["share"] == pytest.approx(share, rel=0.03)
    assert np.sqrt(leak["variance"]) < 0.1 * DEVIATION


def test_a_line_that_is_not_its_pumps_alone_tells_nothing(machine: Machine) -> None:
    cylinder, leak = cylinders_of(machine)[0], leaks_of(1)[0]
    for k in range(200):
        balance(leak, k % WINDOW != 0, 9e-6, LEAKAGE, 6e6, 0.4, cylinder, CAPACITY, STEP)
    assert leak["share"] == 1.0
    assert np.sqrt(leak["variance"]) == pytest.approx(DEVIATION)
