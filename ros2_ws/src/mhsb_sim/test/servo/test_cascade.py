import numpy as np
import pytest

from mhsb_model.machine import Machine
from mhsb_sim.records import Records
from mhsb_sim.servo.cascade import axis_records
from mhsb_sim.servo.natural_frequency import oil_stiffness
from mhsb_sim.simulator import Simulator

SLOW = np.array([-1.1, -0.3, 0.6])  # stretched out low, where J1's moment arm is short


def closed_loop(axes: Records, loaded: Machine, q: np.ndarray) -> np.ndarray:
    """Matrix of the cascade on a machine at q [rad], linear and with ideal valves and supply.

    States: errors e of the cylinder lengths, ė, excess forces f, biases d:
    R⁻¹ M R⁻¹ ë = −f, ḟ = k_h ė + ω_F (d + k_p k_h/ω_F e − f), τ ḋ = f − d.
    """
    inverse_arms = np.diag(1.0 / loaded.moment_arms(q))
    mass = inverse_arms @ loaded.mass_matrix(q) @ inverse_arms
    oil = np.diag(oil_stiffness(loaded, q))
    position, force, bias = (
        np.diag(axes[name]) for name in ("position_gain", "force_bandwidth", "bias_time")
    )
    forget = np.linalg.inv(bias)
    one, none = np.eye(len(q)), np.zeros((len(q), len(q)))
    return np.block(
        [
            [none, one, none, none],
            [none, none, -np.linalg.inv(mass), none],
            [position @ oil, oil, -force, force],
            [none, none, forget, -forget],
        ]
    )


@pytest.mark.parametrize("controller", ["coordinated", "independent"])
@pytest.mark.parametrize("payload", [0.0, 10.0, 13.0])
def test_the_loop_is_stable_in_every_posture_with_any_of_the_payloads(
    machine: Machine, controller: str, payload: float
) -> None:
    axes = axis_records(machine, getattr(machine.config.servo, controller))
    loaded = machine.changed(payload=payload)
    limits = machine.arrays.joint_min, machine.arrays.joint_max
    postures = np.random.default_rng(1).uniform(*limits, (200, machine.joint_count))
    slowest = max(
        np.linalg.eigvals(closed_loop(axes, loaded, q)).real.max() for q in postures
    )
    assert slowest < -0.3


def test_swings_of_the_slowest_posture_die_out_in_the_simulator(machine: Machine) -> None:
    simulator = Simulator(machine, posture=SLOW)
    simulator.set_payload(0.8 * machine.arrays.payload)
    tips = []
    for _ in range(4000):
        simulator.step()
        tips.append(machine.tip_position(simulator.joint_state.position))
    distance = np.hypot(*(np.array(tips) - machine.tip_position(SLOW)).T)
    assert distance.max() > 2e-3
    assert distance[-500:].max() < 5e-4
