import numpy as np
import pytest

from mhsb_model.hydraulics import compute_required_pressure
from mhsb_model.machine import Machine
from mhsb_tools.moves.needed_pressure import compute_needed_pressure

STRETCHED = np.array([0.85, -0.9, -0.5])
N, DB, SB = 0, 1, 2


def reference(position: np.ndarray, velocity: float = 0.0, acceleration: float = 0.0) -> np.ndarray:
    ones = np.ones_like(position)
    return np.array([[position, velocity * ones, acceleration * ones]])


def test_at_rest_it_is_what_holds_the_load(machine: Machine) -> None:
    (need,) = compute_needed_pressure(
        machine, reference(STRETCHED), np.array([[DB, N, N]], np.uint8)
    )
    force = machine.piston_forces(STRETCHED)
    held = [compute_required_pressure(machine.arrays, j, force[j], 0.0) for j in range(3)]
    np.testing.assert_allclose(need, np.maximum(held, machine.arrays.supply_pressure))
    assert need[0] > machine.arrays.supply_pressure


def test_all_on_the_rail_need_what_the_neediest_does(machine: Machine) -> None:
    alone = compute_needed_pressure(
        machine, reference(STRETCHED), np.array([[DB, DB, N]], np.uint8)
    )[0]
    shared = compute_needed_pressure(
        machine, reference(STRETCHED), np.array([[SB, SB, N]], np.uint8)
    )[0]
    np.testing.assert_allclose(shared, [alone.max(), alone.max(), alone[2]])


@pytest.mark.parametrize("motion", [(0.2, 0.0), (0.0, 2.0)])
def test_lifting_and_accelerating_need_more(machine: Machine, motion: tuple[float, float]) -> None:
    modes = np.array([[DB, N, N]], np.uint8)
    still = compute_needed_pressure(machine, reference(STRETCHED), modes)
    assert (
        compute_needed_pressure(machine, reference(STRETCHED, *motion), modes)[0, 0]
        > still[0, 0] + 1e4
    )


def test_lowering_still_needs_the_hold(machine: Machine) -> None:
    modes = np.array([[DB, N, N]], np.uint8)
    still = compute_needed_pressure(machine, reference(STRETCHED), modes)[0, 0]
    lowered = compute_needed_pressure(machine, reference(STRETCHED, -0.05), modes)[0, 0]
    friction = 100.0 / machine.arrays.cap_area[0]
    assert lowered == pytest.approx(still, abs=friction)
