"""Holding modes: the modes in which an arm stays at rest.

An actuator holds in mode N if the main pump's pressure P_S carries its load, otherwise in DB. In
these modes the servo can compensate leakage, so no load sags.
"""

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.errors import MhsbError
from mhsb_model.hydraulics import needs_boost
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode, format_pattern
from mhsb_model.types import FloatArray, ModeArray

MAX_HELD_SPEED = 2e-4
"""Piston speed up to which a cylinder counts as held by its valve [m/s]."""


class HoldingError(MhsbError):
    """The arm has too few booster modules to hold a posture.

    Attributes:
        modes: Modes that the posture needs, shape (n,).
    """

    def __init__(self, modes: ModeArray, needed: int, fitted: int) -> None:
        """Make the message from the modes and the numbers of modules.

        Args:
            modes: Modes that the posture needs, shape (n,).
            needed: Number of booster modules that these modes occupy.
            fitted: Number of booster modules of the machine.
        """
        self.modes = modes
        super().__init__(
            f"to hold the posture, the mode pattern {format_pattern(modes)} needs {needed} booster "
            f"modules, {fitted} are fitted; choose a posture that the supply pressure carries"
        )


def choose_holding_modes(machine: Machine, force: FloatArray) -> ModeArray:
    """Choose the modes in which the cylinders hold their loads at rest.

    An actuator holds in mode N (fed by the main pump alone) if the main pump's pressure is at least
    load pressure plus boost margin. Otherwise it holds in mode DB (boosted by its own servo pump).

    Args:
        machine: The machine, which gives the main pump's pressure and the booster modules.
        force: Piston forces, positive if they resist extension, shape (n,) [N].

    Returns:
        Modes, uint8 of shape (n,).

    Raises:
        HoldingError: These modes need more booster modules than the machine has.
    """
    m = machine.arrays
    modes, needed = _holding_modes(m, np.asarray(force, dtype=np.float64))
    if needed > m.module_count:
        raise HoldingError(modes, needed, m.module_count)
    return modes


def choose_stop_modes(machine: Machine, force: FloatArray, in_force: ModeArray) -> ModeArray:
    """Choose the modes in which an arm holds its loads after a stop.

    The mode of an actuator is N (fed by the main pump alone) if the main pump's pressure is at
    least load pressure plus boost margin. Otherwise it is DB (boosted by its own servo pump). If
    these modes need more booster modules than the machine has, all actuators keep their present
    modes.

    Args:
        machine: The machine.
        force: Piston forces at the stop, positive if they resist extension, shape (n,) [N].
        in_force: Present modes, shape (n,).

    Returns:
        Modes in a new array, uint8 of shape (n,).
    """
    try:
        return choose_holding_modes(machine, force)
    except HoldingError:
        return np.array(in_force, dtype=np.uint8)


@kernel
def _holding_modes(m: MachineArrays, force: FloatArray) -> tuple[ModeArray, int]:
    """Choose the mode in which each cylinder holds its load; the number of modules has no limit.

    The mode is N (fed by the main pump alone) if the main pump's pressure is at least load pressure
    plus boost margin. Otherwise it is DB (boosted by the actuator's own servo pump).

    Args:
        m: Arrays of the machine.
        force: Piston forces, positive if they resist extension, shape (n,) [N].

    Returns:
        Modes, uint8 of shape (n,), and the number of booster modules that they need. It may be more
        than the machine has.
    """
    modes, needed = np.empty(len(force), dtype=np.uint8), 0
    for j in range(len(force)):
        modes[j] = Mode.DB if needs_boost(m, j, force[j], 0.0) else Mode.N
        needed += m.modules_per_mode[modes[j]]
    return modes, needed
