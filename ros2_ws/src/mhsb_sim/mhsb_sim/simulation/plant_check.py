"""Whether a plant can be controlled by one who knows another machine."""

from __future__ import annotations

from collections.abc import Callable

from mhsb_model.machine import Machine
from mhsb_sim.errors import PlantError

COUNTED: tuple[tuple[str, Callable[[Machine], object]], ...] = (
    ("joints", lambda machine: machine.joint_count),
    ("booster modules", lambda machine: machine.arrays.module_count),
)
"""What a plant must have in common with what its servo knows."""


def check_plant(machine: Machine, plant: Machine) -> None:
    """Raise PlantError where one who knows `machine` cannot control `plant` at all."""
    for text, of in COUNTED:
        believed, real = of(machine), of(plant)
        if believed != real:
            raise PlantError(
                f"the plant has {real} {text}, the machine that its servo knows has {believed}; "
                "both files must describe arms of the same build"
            )
