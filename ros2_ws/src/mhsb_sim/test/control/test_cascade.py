import numpy as np
import pytest

from mhsb_control import read_gains
from mhsb_control.stability import SLOWEST_DECAY, compute_slowest_decay
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import standstill
from mhsb_sim.simulation.simulator import Simulator

SLOW = np.array([-1.1, -0.3, 0.6])  # stretched out low, where J1's moment arm is short


@pytest.mark.parametrize("controller", ["coordinated", "independent"])
@pytest.mark.parametrize("payload", [0.0, 10.0, 13.0])
def test_the_loop_is_stable_in_every_posture_with_any_of_the_payloads(
    machine: Machine, controller: str, payload: float
) -> None:
    gains = read_gains(machine, controller)
    assert compute_slowest_decay(machine, gains, payload) > SLOWEST_DECAY


@pytest.mark.parametrize("controller", ["coordinated", "independent"])
@pytest.mark.parametrize("payload", [0.0, 13.0])
def test_it_is_stable_as_well_where_the_servo_knows_of_the_payload(
    machine: Machine, controller: str, payload: float
) -> None:
    gains = read_gains(machine, controller)
    loaded = machine.changed(payload=payload)
    assert compute_slowest_decay(loaded, gains, payload) > SLOWEST_DECAY


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


@pytest.mark.parametrize("controller", ["coordinated", "independent"])
@pytest.mark.parametrize("way", [-0.03, 0.03])
def test_an_arm_that_is_off_its_reference_at_rest_comes_back_slowly(
    machine: Machine, controller: str, way: float
) -> None:
    """As one that has sagged while a pump was dead, and is healed before it was stopped for it."""
    simulator = Simulator(machine, controller)
    simulator.advance(0.2)
    now, modes = simulator.time_ns, simulator.modes
    goal = simulator.reference.position + way
    simulator.set_plan(
        standstill(goal, now), ModeSchedule(now, np.zeros(1, dtype=np.int64), modes[None])
    )
    positions = []
    for _ in range(3000):
        simulator.step()
        positions.append(simulator.joint_state.position)
    speed = np.abs(np.array(positions)[100:] - positions[:-100]) / 0.1
    assert 0.02 < speed.max() < 0.05
    assert np.abs(positions[-1] - goal).max() < 0.2 * abs(way)
