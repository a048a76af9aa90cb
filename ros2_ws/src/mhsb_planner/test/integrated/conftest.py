"""Both kinds of machines, and the terms by which routes are priced in these tests."""

from collections.abc import Callable

import numpy as np
import pytest

from mhsb_model.machine import Machine
from mhsb_planner.integrated.cylinder_path import PathCostModel, cost_model
from mhsb_planner.search.manipulability_loss import WITHOUT_AREA


@pytest.fixture(params=["slider_cranks", "four_bars"])
def arm(request: pytest.FixtureRequest, machine: Machine, four_bar_machine: Machine) -> Machine:
    return machine if request.param == "slider_cranks" else four_bar_machine


@pytest.fixture(scope="session")
def terms_of() -> Callable[..., PathCostModel]:
    """Function (machine, weights=(0.5, 1, 2), area=none) that gives terms from NNN, `paper`."""

    def make(machine: Machine, weights=(0.5, 1.0, 2.0), area=WITHOUT_AREA) -> PathCostModel:
        normal, weight = np.zeros(3, dtype=np.uint8), np.array(weights, dtype=float)
        return cost_model(machine, normal, weight, 1, area)

    return make


@pytest.fixture(scope="session")
def posture_within() -> Callable[..., np.ndarray]:
    """Function (machine, random) that draws a posture within limits, the tip in the workspace."""

    def draw(machine: Machine, random: np.random.Generator) -> np.ndarray:
        limits, area = machine.arrays, machine.config.workspace
        while True:
            q = random.uniform(limits.joint_min, limits.joint_max)
            x, z = machine.tip_position(q)
            if x > area.min_x and area.min_radius < np.hypot(x, z) < area.max_radius:
                return q

    return draw
