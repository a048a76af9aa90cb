"""Positions of join valves and diverters, which the servo assumes because they have no sensors."""

from mhsb_model.circuit.components import Components
from mhsb_model.circuit.elements import advance_first_order_lag
from mhsb_model.kernels.kernel import kernel


@kernel(borrows=True)
def update_assumed_valves(circuit: Components) -> None:
    """Advance the assumed positions of join valves and diverters by one servo step.

    Join valves connect supply lines to the shared rail; diverters lead a booster module's flow to
    the rail. Neither has a sensor, so the servo computes both positions from its own commands, as
    first-order lags. Diverters of spare modules, which have no line of their own, do not move.

    Args:
        circuit: The circuit as the servo knows it. Writes `join` of the actuators and `to_rail` of
            the modules in place, both from 0 (closed) to 1 (open).
    """
    decay = circuit.constants[0].switching_decay
    for j in range(len(circuit.actuators)):
        actuator = circuit.actuators[j]
        actuator.join = advance_first_order_lag(actuator.join, actuator.join_command, decay)
    for k in range(len(circuit.modules)):
        module = circuit.modules[k]
        if circuit.module_home[k] >= 0:
            module.to_rail = advance_first_order_lag(module.to_rail, module.to_rail_command, decay)
