"""Positions of join valves and diverters, which have no sensors, as the servo assumes them."""

from __future__ import annotations

from mhsb_model.circuit.components import Components
from mhsb_model.circuit.elements import advance_first_order_lag
from mhsb_model.kernels.kernel import kernel


@kernel(borrows=True)
def update_assumed_valves(circuit: Components) -> None:
    """Advance the assumed positions of join valves and diverters by one servo step.

    The servo knows the positions from its commands alone. Join valves connect lines to the rail;
    diverters lead a module's flow to the rail. Both follow their commands as first-order lags.
    Diverters of modules without an actuator do not move.

    Args:
        circuit: The circuit as the servo knows it. Writes `join` of the actuators and
            `to_rail` of the modules in place, both from 0 (closed) to 1.
    """
    decay = circuit.constants[0].switching_decay
    for j in range(len(circuit.actuators)):
        actuator = circuit.actuators[j]
        actuator.join = advance_first_order_lag(actuator.join, actuator.join_command, decay)
    for k in range(len(circuit.modules)):
        module = circuit.modules[k]
        if circuit.module_home[k] >= 0:
            module.to_rail = advance_first_order_lag(module.to_rail, module.to_rail_command, decay)
