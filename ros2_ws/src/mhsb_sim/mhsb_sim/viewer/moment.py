"""What is known of the arm at one time, live or recorded, and the last of these for plots."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from mhsb_model.types import FloatArray, ModeArray

NO_NUMBERS = np.full(4, np.nan)


@dataclass(frozen=True, eq=False)
class Moment:
    """An arm with n joints at one time.

    time             s
    posture          float64[n], rad
    modes            uint8[n]
    supply_pressure  float64[n], in the lines that feed the valves, Pa; not a number if unknown
    energy           float64[4], as `energy_flow.NAMES` tells, J; likewise
    """

    time: float
    posture: FloatArray
    modes: ModeArray
    supply_pressure: FloatArray
    energy: FloatArray = field(default_factory=NO_NUMBERS.copy)


@dataclass(frozen=True, eq=False)
class Lines:
    """Moments as columns, k of them.

    time             float64[k], s
    supply_pressure  float64[k, n], Pa
    modes            uint8[k, n]
    energy           float64[k, 4], J
    """

    time: FloatArray
    supply_pressure: FloatArray
    modes: ModeArray
    energy: FloatArray


class History:
    """The moments of the last `span` s, their times counted from the first one that came."""

    def __init__(self, span: float) -> None:
        self._span = span
        self._began = 0.0
        self._moments: deque[Moment] = deque()

    def add(self, moment: Moment) -> None:
        """One more; time that goes back begins anew."""
        kept = self._moments
        if kept and moment.time < kept[-1].time:
            kept.clear()
        if not kept:
            self._began = moment.time
        kept.append(moment)
        while kept[0].time < moment.time - self._span:
            kept.popleft()

    def lines(self) -> Lines:
        """What there is, which must not be nothing."""
        kept = list(self._moments)
        return Lines(
            np.array([each.time - self._began for each in kept]),
            np.array([each.supply_pressure for each in kept]),
            np.array([each.modes for each in kept]),
            np.array([each.energy for each in kept]),
        )
