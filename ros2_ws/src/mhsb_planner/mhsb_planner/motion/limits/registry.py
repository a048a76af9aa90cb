"""Registry of the limits that every motion has to keep.

A new limit on the state of a motion needs a module, and three lines here: its import, its place in
`STATE_LIMITS`, and its call in `measure_limits`. Both lists must have the same order.
"""

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_planner.motion.limits import (
    holding_pressure,
    joint_range,
    module_budget,
    node_set,
    thrust,
    usage,
)
from mhsb_planner.motion.limits.limit import LimitInputs, StateLimit

STATE_LIMITS: tuple[StateLimit, ...] = (
    module_budget.MODULE_LIMIT,
    joint_range.JOINT_LIMIT,
    node_set.NODE_SET_LIMIT,
    usage.USAGE_LIMIT,
    holding_pressure.HOLDING_PRESSURE_LIMIT,
    thrust.THRUST_LIMIT,
)
"""Limits on the state of a motion, in the order in which they are checked at an instant."""


@kernel(borrows=True, forceinline=True)
def measure_limits(m: MachineArrays, state: LimitInputs) -> tuple[float, ...]:
    """Return the quantity of each limit in `STATE_LIMITS` at one instant.

    Args:
        m: Arrays of the machine.
        state: State of the motion at this instant. Its `scratch` is overwritten.

    Returns:
        One quantity for each limit, in the order of `STATE_LIMITS`.
    """
    return (
        module_budget.measure_module_excess(m, state),
        joint_range.measure_joint_excess(m, state),
        node_set.measure_tip_excess(m, state),
        usage.measure_usage(m, state),
        holding_pressure.measure_holding_pressure(m, state),
        thrust.measure_thrust(m, state),
    )
