from typing import Any

import numpy as np
import pytest

from mhsb_control import REGISTERED_CONTROLLERS, get_controller_class
from mhsb_control.cascade import (
    ControlAxis,
    build_gain_record,
    compute_supply_need,
    joins_rail,
    set_supply_targets,
)
from mhsb_control.errors import UnknownControllerError
from mhsb_model.hydraulics import MARGIN_SHARE_WITHOUT_INERTIA, compute_required_pressure
from mhsb_model.machine import Machine
from mhsb_model.records import create_records
from mhsb_sim.circuit.network import build_circuit


def test_controllers_are_found_by_name() -> None:
    for name, controller in REGISTERED_CONTROLLERS.items():
        assert get_controller_class(name) is controller
    with pytest.raises(UnknownControllerError):
        get_controller_class("fuzzy")


MARGIN = 1e5


@pytest.fixture
def oil(machine: Machine) -> tuple[Any, ...]:
    """The first cylinder, the circuit's constants and gains with a margin of the servo's own."""
    circuit = build_circuit(machine, 5e-4)
    gains = build_gain_record(machine, MARGIN)
    return circuit.cylinders[0], circuit.constants, gains


@pytest.mark.parametrize(("force", "speed"), [(3000.0, 0.008), (2500.0, 0.0), (-2000.0, -0.01)])
def test_the_supply_need_is_the_planners_law_plus_the_servos_margin(
    machine: Machine, oil: tuple[Any, ...], force: float, speed: float
) -> None:
    held, moved = (compute_required_pressure(machine.arrays, 0, force, v) for v in (0.0, speed))
    found = compute_supply_need(force, force, speed, *oil)
    assert found == pytest.approx(max(held, moved) + MARGIN, rel=1e-12)


def test_braking_a_load_on_its_way_down_needs_no_more_than_holding_it(
    machine: Machine, oil: tuple[Any, ...]
) -> None:
    found = compute_supply_need(2500.0, 3500.0, -0.01, *oil)
    assert found == pytest.approx(
        compute_required_pressure(machine.arrays, 0, 2500.0, 0.0) + MARGIN
    )


def test_inertia_uses_up_its_part_of_the_margin_before_more_is_boosted(
    machine: Machine, oil: tuple[Any, ...]
) -> None:
    m, speed = machine.arrays, 0.008
    static = compute_required_pressure(m, 0, 3000.0, speed) + MARGIN
    spared = (1.0 - MARGIN_SHARE_WITHOUT_INERTIA) * m.boost_margin
    gentle = 0.9 * spared * m.cap_area[0]
    assert compute_supply_need(3000.0, 3000.0 + gentle, speed, *oil) == pytest.approx(static)
    hard = 3000.0 + 2.0 * spared * m.cap_area[0]
    dynamic = compute_required_pressure(m, 0, hard, speed) + MARGIN - spared
    assert compute_supply_need(3000.0, hard, speed, *oil) == pytest.approx(dynamic)


def test_the_supply_need_stays_between_the_main_pump_and_the_highest_boost(
    machine: Machine, oil: tuple[Any, ...]
) -> None:
    assert compute_supply_need(0.0, 0.0, 0.0, *oil) == machine.arrays.supply_pressure
    assert compute_supply_need(9000.0, 9000.0, 0.0, *oil) == machine.arrays.max_boost_pressure


def test_the_target_of_now_covers_what_is_ahead(oil: tuple[Any, ...]) -> None:
    axis = create_records(ControlAxis, 1)
    axis["holding_force_to_pump"], axis["holding_force_ahead"] = 2000.0, 3000.0
    set_supply_targets(axis[0], *oil)
    assert axis["supply_target"][0] == axis["target_ahead"][0]
    axis["holding_force_to_pump"] = 4000.0
    set_supply_targets(axis[0], *oil)
    assert axis["supply_target"][0] > axis["target_ahead"][0]


def test_a_load_that_is_about_to_turn_round_is_charged_for_with_its_whole_force(
    machine: Machine, oil: tuple[Any, ...]
) -> None:
    axis = create_records(ControlAxis, 1)
    axis["holding_force_to_pump"] = axis["holding_force_ahead"] = 2000.0
    axis["force_to_pump"], axis["speed_to_pump"] = 3500.0, -0.01
    axis["speed"], axis["speed_ahead"] = -0.01, -0.005
    set_supply_targets(axis[0], *oil)
    held = compute_required_pressure(machine.arrays, 0, 2000.0, 0.0) + MARGIN
    assert axis["supply_target"][0] == pytest.approx(held)
    axis["speed_ahead"] = 0.005
    set_supply_targets(axis[0], *oil)
    turned = compute_required_pressure(machine.arrays, 0, 3500.0, 0.0) + MARGIN
    assert axis["supply_target"][0] == pytest.approx(turned)


def test_shared_boost_and_foreign_modules_draw_on_the_rail() -> None:
    home = np.array([0, 1, 2, -1])
    modes = np.array([2, 1, 1], np.uint8)
    serves = np.array([0, 1, -1, 2])
    assert [joins_rail(j, modes, home, serves) for j in range(3)] == [True, False, True]
