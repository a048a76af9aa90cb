"""Pacing: how far the simulation should have come by now.

At real-time factor 1 and without a clock of its own, simulated time is the system's time, so that
every node on the machine agrees on it. Otherwise it runs from where it started at its own rate and
the simulator is the source of /clock.
"""

from __future__ import annotations

from dataclasses import dataclass

LARGEST_LAG_NS = 5_000_000_000
"""Time that is caught up at once, after a freeze; what lies further back is left out."""


@dataclass
class Pacer:
    """Maps a clock's time [ns] to simulated time [ns], at `factor` simulated seconds per second."""

    factor: float
    clock_ns: int
    sim_ns: int

    def due_ns(self, clock_ns: int) -> int:
        """Simulated time that should have been reached."""
        return self.sim_ns + round((clock_ns - self.clock_ns) * self.factor)

    def restart(self, clock_ns: int, sim_ns: int) -> None:
        """Count from here: after a change of factor, a reset, or a jump of the clock."""
        self.clock_ns, self.sim_ns = clock_ns, sim_ns
