"""Holding modes: in which an arm stays at rest.

N where P_S carries an actuator's load, DB elsewhere, so that the servo can make up for what leaks
and no load sags.
"""

from __future__ import annotations

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.errors import MhsbError
from mhsb_model.hydraulics import needs_boost
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode, pattern_name
from mhsb_model.types import FloatArray, ModeArray


class HoldingError(MhsbError):
    """Too few booster modules are fitted to hold a posture; `modes` are those that it takes."""

    def __init__(self, modes: ModeArray, needed: int, fitted: int) -> None:
        self.modes = modes
        self.needed = needed
        self.fitted = fitted
        super().__init__(
            f"to hold the posture, the mode pattern {pattern_name(modes)} needs {needed} booster "
            f"modules, {fitted} are fitted; choose a posture that the supply pressure carries"
        )


def holding_modes(machine: Machine, force: FloatArray) -> ModeArray:
    """Modes that hold the cylinders' loads `force` float64[n] N at rest, uint8[n].

    Raises HoldingError where that takes more modules than there are.
    """
    m = machine.arrays
    modes = _holding_modes(m, np.asarray(force, dtype=np.float64))
    needed = int(m.modules_per_mode[modes].sum())
    if needed > m.module_count:
        raise HoldingError(modes, needed, m.module_count)
    return modes


def modes_to_stop(machine: Machine, force: FloatArray, in_force: ModeArray) -> ModeArray:
    """`holding_modes` where an arm must come to rest, whatever its modules can hold there.

    Where they are too few, the modes in force stay: a stop is not refused.
    """
    try:
        return holding_modes(machine, force)
    except HoldingError:
        return np.array(in_force, dtype=np.uint8)


@kernel
def _holding_modes(m: MachineArrays, force: FloatArray) -> ModeArray:
    modes = np.empty(len(force), dtype=np.uint8)
    for j in range(len(force)):
        modes[j] = Mode.DB if needs_boost(m, j, force[j], 0.0) else Mode.N
    return modes
