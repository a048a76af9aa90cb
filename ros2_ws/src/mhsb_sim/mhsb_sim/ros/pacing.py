"""Pacing: how far the simulation is to advance each time its node wakes.

Simulated time runs at `factor` times a steady clock, which no correction of the system's clock
affects. A lag, after a freeze or on a busy machine, is made up at a slightly higher speed, so that
nothing that follows the reference sees a jump. A lag beyond `LARGEST_LAG_NS` is given up, and
simulated time stays behind by the rest.
"""

LARGEST_LAG_NS = 2_000_000_000
"""Largest lag that is made up, in clock time [ns]."""

CATCH_UP = 1.25
"""Largest speed while a lag is made up, relative to the normal one."""

LONGEST_WAKE_NS = 50_000_000
"""Longest time between two wakes that is simulated at once [ns]."""

LAGS_NS, KEEPS_UP_NS = 100_000_000, 20_000_000
"""Lags [ns]: the simulation counts as lagging above the first, until it is below the second."""


class Pacer:
    """Maps the time of a steady clock to simulated time.

    Attributes:
        factor: Simulated seconds per second of the clock.
        clock_ns: Clock time of the reference instant [ns]. The lag is 0 at this instant.
        sim_ns: Simulated time of that instant [ns].
        lag_ns: Lag of simulated time at the last wake, in clock time [ns].
        lags: Whether the lag is large enough for a warning.
    """

    def __init__(self, factor: float) -> None:
        """Begin at the reference instant 0, with the simulated time 0."""
        self.factor = factor
        self.restart(0, 0)

    def restart(self, clock_ns: int, sim_ns: int) -> None:
        """Make the present the reference instant, so that the lag is 0 now.

        Call it after a change of `factor` and after a reset of simulated time.

        Args:
            clock_ns: Present time of the steady clock [ns].
            sim_ns: Simulated time at that instant [ns].
        """
        self.clock_ns, self.sim_ns = clock_ns, sim_ns
        self.lag_ns, self.lags = 0, False
        self._woken_ns = clock_ns

    def compute_due_ns(self, clock_ns: int, sim_ns: int) -> int:
        """Compute the simulated time that is to be reached now, and update `lag_ns` and `lags`.

        The node calls it each time it wakes. The result is the simulated time that belongs to the
        clock time. At most CATCH_UP × `factor` × (clock time since the previous call) is simulated.
        At most LONGEST_WAKE_NS of clock time counts for one call. The part of a lag beyond
        LARGEST_LAG_NS is given up: the reference instant is moved by it. `lags` becomes True above
        a lag of LAGS_NS, and False again at KEEPS_UP_NS.

        Args:
            clock_ns: Present time of the steady clock [ns].
            sim_ns: Present simulated time [ns].

        Returns:
            Simulated time to be reached [ns]. It is before `sim_ns` if the simulation is ahead.
        """
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
