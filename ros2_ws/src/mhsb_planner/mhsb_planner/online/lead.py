"""How far ahead a new plan leaves the old one: as far as planning and its way to the arm take.

The lead is the 0.95 quantile of the time to the first feasible motion, plus that of the time from
there until the arm has confirmed a plan. What improving takes does not count: it gets what the
lead leaves. Recent plans count more, so that a lead that load has made long falls soon after.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from mhsb_model.types import FloatArray

QUANTILE = 0.95
PLANS = 50
HALF_LIFE = 4.0
"""So many plans later a sample counts half: what 20 plans ago was usual has no say in 0.95."""

LONGER = 1.5
"""Factor of the lead for a plan that is made again, because the one before was late."""

KEPT = 0.15
"""What comes after planning is given this share of the time to the first motion, at least: where
plans take long, their way to the arm stalls, too, and a late one costs its whole lead."""

OFFLINE_LEAD = 0.1
"""Of plans made in simulated time, which stands still meanwhile [s]."""

FIRST_MOTION, FLIGHT = 0.05, 0.02
"""What is taken before anything has been measured [s]."""


class Lead(NamedTuple):
    """What a plan is given [s].

    total    from its stamp to where it leaves the one before
    flight   of that, kept for what comes after planning
    longest  whether no longer lead is allowed
    """

    total: float
    flight: float
    longest: bool


class LeadEstimate:
    """Learns from every plan how long the next ones will take; all times in real seconds."""

    def __init__(self) -> None:
        self._first_motion: deque[float] = deque([FIRST_MOTION], maxlen=PLANS)
        self._flight: deque[float] = deque([FLIGHT], maxlen=PLANS)

    def add_first_motion(self, seconds: float) -> None:
        """From when a plan is wanted to its first feasible motion."""
        self._first_motion.append(seconds)

    def add_flight(self, seconds: float) -> None:
        """From the end of planning until the arm has confirmed: encoding, transport, receiver."""
        self._flight.append(seconds)

    @property
    def flight(self) -> float:
        """Time to keep for what comes after planning [s]."""
        return recent_quantile(np.array(self._flight))

    @property
    def lead(self) -> float:
        """Time from a plan's stamp to where it should leave the one before [s]."""
        return recent_quantile(np.array(self._first_motion)) + self._kept

    @property
    def _kept(self) -> float:
        return max(self.flight, KEPT * recent_quantile(np.array(self._first_motion)))

    def split(self, shortest: float, longest: float, fixed: float, stretch: float) -> Lead:
        """The lead between two bounds, or a fixed one unless that is 0, all in s.

        stretch  factor for a plan that was late before
        """
        wanted = stretch * self.lead
        total = fixed or min(max(wanted, shortest), longest)
        flight = min(stretch * self._kept, 0.5 * total)
        return Lead(total, flight, longest=fixed > 0.0 or wanted >= longest)


def recent_quantile(samples: FloatArray, quantile: float = QUANTILE) -> float:
    """Least sample at or below which lie a share `quantile` of the weights, newest sample last.

    A sample's weight halves with every HALF_LIFE newer ones.
    """
    weight = 0.5 ** (np.arange(len(samples))[::-1] / HALF_LIFE)
    order = np.argsort(samples)
    share = np.cumsum(weight[order]) / weight.sum()
    row = min(int(np.searchsorted(share, quantile - 1e-12)), len(samples) - 1)
    return float(samples[order][row])
