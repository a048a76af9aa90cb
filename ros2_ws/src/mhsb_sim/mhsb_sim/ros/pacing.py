"""Pacing: how far the simulation should come, each time its node wakes.

Simulated time runs at `factor` times a steady clock, which no correction of the system's clock can
turn back or ahead. What the simulation lags behind, after a freeze or on a busy machine, it makes
up a little faster than it runs, so that nothing that follows its reference sees a leap; what lies
further back than `LARGEST_LAG_NS` is given up, and simulated time stays behind.
"""

from __future__ import annotations

from dataclasses import dataclass

LARGEST_LAG_NS = 2_000_000_000
"""Time of the clock that is made up; what lies further back is left out."""

CATCH_UP = 1.25
"""Greatest pace while a lag is made up, in paces."""

LONGEST_WAKE_NS = 50_000_000
"""Time between two wakes up to which it is made up at once."""

LAGS_NS, KEEPS_UP_NS = 100_000_000, 20_000_000
"""Beyond the first the simulation counts as lagging, until it is within the second again."""


@dataclass
class Pacer:
    """Maps a steady clock's time [ns] to simulated time [ns], `factor` seconds per second.

    clock_ns, sim_ns  from which instant on it counts
    lag_ns            time of the clock that simulated time was behind at the last wake
    lags              whether that is worth a warning
    """

    factor: float
    clock_ns: int
    sim_ns: int
    lag_ns: int = 0
    lags: bool = False

    def __post_init__(self) -> None:
        self._woken_ns = self.clock_ns

    def due_ns(self, clock_ns: int, sim_ns: int) -> int:
        """How far to simulate in a wake at `clock_ns`, from where the simulation is."""
        passed_ns = min(clock_ns - self._woken_ns, LONGEST_WAKE_NS)
        self._woken_ns = clock_ns
        ideal_ns = self.sim_ns + round((clock_ns - self.clock_ns) * self.factor)
        self.lag_ns = round((ideal_ns - sim_ns) / self.factor)
        if self.lag_ns > LARGEST_LAG_NS:
            given_up_ns = self.lag_ns - LARGEST_LAG_NS
            self.clock_ns += given_up_ns
            self.lag_ns = LARGEST_LAG_NS
            ideal_ns -= round(given_up_ns * self.factor)
        self.lags = self.lag_ns > (KEEPS_UP_NS if self.lags else LAGS_NS)
        return min(ideal_ns, sim_ns + round(passed_ns * self.factor * CATCH_UP))

    def restart(self, clock_ns: int, sim_ns: int) -> None:
        """Count from here: after a change of factor, or a reset."""
        self.clock_ns, self.sim_ns = clock_ns, sim_ns
        self.lag_ns, self.lags = 0, False
        self._woken_ns = clock_ns
