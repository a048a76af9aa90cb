"""Simulator: mechanics, hydraulic circuit, servo, plans and faults in lock-step."""

from typing import TYPE_CHECKING

from mhsb_model import import_on_use

if TYPE_CHECKING:
    from mhsb_sim.simulation.simulator import Simulator as Simulator
    from mhsb_sim.simulation.supervised_arm import SupervisedArm as SupervisedArm

__getattr__, __dir__ = import_on_use(
    __name__,
    {
        "Simulator": "mhsb_sim.simulation.simulator",
        "SupervisedArm": "mhsb_sim.simulation.supervised_arm",
    },
)
