"""Limit of the booster modules that the modes of all actuators use.

    Σ_j n(mode_j) ≤ n_fitted

n(mode) is the number of booster modules that a mode uses, and n_fitted the number in the machine.

Source: paper, Section 3.
"""

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import ModeArray
from mhsb_planner.motion.limits.limit import LimitInputs, StateLimit


@kernel(borrows=True, forceinline=True)
def count_used_modules(m: MachineArrays, modes: ModeArray) -> int:
    """Count the booster modules that a mode combination uses.

    Args:
        m: Arrays of the machine.
        modes: Mode code of each actuator, shape (n,).

    Returns:
        Number of booster modules.
    """
    used = 0
    for mode in modes:
        used += m.modules_per_mode[mode]
    return used


@kernel(borrows=True, forceinline=True)
def measure_module_excess(m: MachineArrays, state: LimitInputs) -> float:
    """Return the number of booster modules that the modes use, minus the number in the machine.

    Args:
        m: Arrays of the machine.
        state: State of the motion at one instant; only the modes count.

    Returns:
        Difference; above 0 if the machine has too few modules.
    """
    return float(count_used_modules(m, state.modes) - m.module_count)


MODULE_LIMIT = StateLimit(
    name="module budget",
    describe=lambda broken: f"{broken.amount:.0f} booster modules more than fitted are needed",
    measure=measure_module_excess,
    limit=0.0,
    broken_above=0.0,
    proven_below=0.5,
    clear_below=0.5,
)
"""Limit of the booster modules; its quantity is the number of missing modules."""
