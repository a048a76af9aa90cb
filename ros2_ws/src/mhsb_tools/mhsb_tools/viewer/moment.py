"""State of the arm at one instant, live or recorded, and a history of states for plots."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from mhsb_model.types import FloatArray, ModeArray

NO_NUMBERS = np.full(4, np.nan)
"""Energies that are all unknown."""


@dataclass(frozen=True, eq=False)
class ArmSnapshot:
    """State of an arm with n joints at one instant.

    Attributes:
        time: Time of the state [s].
        posture: Joint positions, shape (n,) [rad; m for telescopes].
        modes: Mode codes in force, uint8 (n,).
        supply_pressure: Pressure in the line that feeds each valve, shape (n,) [Pa]; nan if
            unknown.
        energy: Energies in the order of `energy_flow.ITEM_NAMES`, shape (4,) [J]; nan if unknown.
    """

    time: float
    posture: FloatArray
    modes: ModeArray
    supply_pressure: FloatArray
    energy: FloatArray = field(default_factory=NO_NUMBERS.copy)


@dataclass(frozen=True, eq=False)
class SnapshotColumns:
    """States of an arm with n joints at k instants, as columns.

    Attributes:
        time: Time of each state, shape (k,) [s].
        supply_pressure: Pressure in the line that feeds each valve, shape (k, n) [Pa]; nan if
            unknown.
        modes: Mode codes in force, uint8 (k, n).
        energy: Energies in the order of `energy_flow.ITEM_NAMES`, shape (k, 4) [J]; nan if unknown.
    """

    time: FloatArray
    supply_pressure: FloatArray
    modes: ModeArray
    energy: FloatArray


class SnapshotHistory:
    """States of the arm from a limited time before the last state on."""

    def __init__(self, span: float) -> None:
        """Create an empty history.

        Args:
            span: Time before the last state for which states are kept [s].
        """
        self._span = span
        self._began = 0.0
        self._moments: deque[ArmSnapshot] = deque()

    def add(self, moment: ArmSnapshot) -> None:
        """Add a state, and discard those that are more than the span older than this one.

        If the new state is earlier than the previous state, as after a restart of the simulator,
        the history is cleared first.

        Args:
            moment: The state.
        """
        kept = self._moments
        if kept and moment.time < kept[-1].time:
            kept.clear()
        if not kept:
            self._began = moment.time
        kept.append(moment)
        while kept[0].time < moment.time - self._span:
            kept.popleft()

    def get_columns(self) -> SnapshotColumns:
        """Return the kept states as columns; the history must not be empty.

        Returns:
            The states in time order. Times [s] count from the first state that was added to the
            empty or cleared history.
        """
        kept = list(self._moments)
        return SnapshotColumns(
            np.array([each.time - self._began for each in kept]),
            np.array([each.supply_pressure for each in kept]),
            np.array([each.modes for each in kept]),
            np.array([each.energy for each in kept]),
        )
