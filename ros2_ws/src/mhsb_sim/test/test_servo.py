import numpy as np
import pytest

from mhsb_model.hydraulics import required_pressure
from mhsb_model.machine import Machine
from mhsb_sim.circuit import build_circuit
from mhsb_sim.errors import UnknownControllerError
from mhsb_sim.servo import CONTROLLERS, controller_class
from mhsb_sim.servo.cascade import AXIS, gain_record, joins_rail, set_targets, supply_need


def test_controllers_are_found_by_name() -> None:
    for name, controller in CONTROLLERS.items():
        assert controller_class(name) is controller
    with pytest.raises(UnknownControllerError):
        controller_class("fuzzy")


@pytest.mark.parametrize(("force", "speed"), [(3000.0, 0.008), (2500.0, 0.0), (-2000.0, -0.01)])
def test_the_supply_need_is_the_planners_law_plus_the_servos_margin(
    machine: Machine, force: float, speed: float
) -> None:
    circuit = build_circuit(machine, 5e-4)
    gains = gain_record(machine)
    found = supply_need(force, speed, circuit.cylinders[0], circuit.constants, gains)
    held, moved = (required_pressure(machine.arrays, 0, force, v) for v in (0.0, speed))
    expected = max(held, moved) + machine.config.servo.supply_margin
    assert found == pytest.approx(expected, rel=1e-12)


def test_the_supply_need_stays_between_the_main_pump_and_the_highest_boost(
    machine: Machine,
) -> None:
    circuit = build_circuit(machine, 5e-4)
    gains = gain_record(machine)
    arguments = (circuit.cylinders[0], circuit.constants, gains)
    assert supply_need(0.0, 0.0, *arguments) == machine.arrays.supply_pressure
    assert supply_need(9000.0, 0.0, *arguments) == machine.arrays.max_boost_pressure


def test_the_target_of_now_covers_what_is_ahead(machine: Machine) -> None:
    axis = np.zeros(1, AXIS)
    axis["force"], axis["force_ahead"] = 2000.0, 3000.0
    circuit = build_circuit(machine, 5e-4)
    gains = gain_record(machine)
    set_targets(axis[0], circuit.cylinders[0], circuit.constants, gains)
    assert axis["supply_target"][0] == axis["target_ahead"][0]
    axis["force"] = 4000.0
    set_targets(axis[0], circuit.cylinders[0], circuit.constants, gains)
    assert axis["supply_target"][0] > axis["target_ahead"][0]


def test_shared_boost_and_foreign_modules_draw_on_the_rail() -> None:
    home = np.array([0, 1, 2, -1])
    modes = np.array([2, 1, 1], np.uint8)
    serves = np.array([0, 1, -1, 2])
    assert [joins_rail(j, modes, home, serves) for j in range(3)] == [True, False, True]
