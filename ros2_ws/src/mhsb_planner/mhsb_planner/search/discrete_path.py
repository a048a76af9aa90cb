"""The discrete path, the result of a search over tip positions, postures and mode combinations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mhsb_model.types import FloatArray, ModeArray, as_frozen


@dataclass(frozen=True)
class SearchStatistics:
    """Effort of a search.

    Attributes:
        expanded: Number of states whose outgoing steps were examined.
        generated: Number of steps examined.
        seconds: Duration of the search [s].
        out_of_time: True if a deadline ended the search; the path is then the best path until the
            deadline.
    """

    expanded: int
    generated: int
    seconds: float
    out_of_time: bool = False


@dataclass(frozen=True, eq=False)
class DiscretePath:
    """Discrete path of k steps for an arm with n joints.

    Each step has constant piston speeds and one mode combination, that is, one mode for each
    actuator. The energy reading `paper` is the published energy model. The reading `series` counts
    main pump and servo pump in series (`s2_step`).

    Attributes:
        tip: Tip positions, shape (k + 1, 2), (x, z) [m]. Shape (k + 1, 3), (x, y, z), if joint 1
            slews.
        posture: Joint positions at the ends of the steps, shape (k + 1, n) [rad or m].
        modes: Mode code (0 N, 1 DB, 2 SB) of every actuator during each step, shape (k, n).
        duration: Duration of each step, shape (k,) [s].
        energy: Energy of each step under the energy reading `paper`, shape (k,) [J].
        energy_series: Energy of each step under the energy reading `series`, shape (k,) [J].
        cost: Total cost w₁ Σ E + w₂ Σ T + w₃ (`switches` + `holding_switches`) [-]. The term w₄ M
            is added if the manipulability loss M has a weight.
        start_modes: Modes in force before the first step, shape (n,).
        statistics: Effort of the search.
        holding_switches: Number of switches after the last step, to the modes that hold the arm at
            rest. Only the integrated search counts them in `cost`; otherwise 0.
    """

    tip: FloatArray
    posture: FloatArray
    modes: ModeArray
    duration: FloatArray
    energy: FloatArray
    energy_series: FloatArray
    cost: float
    start_modes: ModeArray
    statistics: SearchStatistics
    holding_switches: int = 0

    def __post_init__(self) -> None:
        """Convert all arrays to read-only arrays of their types."""
        for name in ("tip", "posture", "duration", "energy", "energy_series"):
            values = np.asarray(getattr(self, name), dtype=float)
            object.__setattr__(self, name, as_frozen(values))
        for name in ("modes", "start_modes"):
            codes = np.asarray(getattr(self, name), dtype=np.uint8)
            object.__setattr__(self, name, as_frozen(codes))

    @classmethod
    def create_without_steps(
        cls, tip: FloatArray, posture: FloatArray, modes: ModeArray, seconds: float
    ) -> DiscretePath:
        """Create a discrete path without steps, for a start that is already at its goal.

        Args:
            tip: Tip position of the start, shape (2,) or (3,) [m].
            posture: Joint positions of the start, shape (n,) [rad or m].
            modes: Modes in force at the start, shape (n,).
            seconds: Duration of the search, for the statistics [s].

        Returns:
            A path with one posture, no steps and cost 0. Its statistics count no states and no
            steps.
        """
        nothing = np.empty(0)
        return cls(
            tip=np.atleast_2d(tip),
            posture=np.atleast_2d(posture),
            modes=np.empty((0, len(modes)), dtype=np.uint8),
            duration=nothing,
            energy=nothing,
            energy_series=nothing,
            cost=0.0,
            start_modes=modes,
            statistics=SearchStatistics(0, 0, seconds),
        )

    @property
    def steps(self) -> int:
        """Number of steps k."""
        return len(self.duration)

    @property
    def switches(self) -> int:
        """Number of mode switches of the path, summed over all actuators.

        This includes switches from the modes in force at the start to the modes of the first step.
        """
        first = np.count_nonzero(self.modes[:1] != self.start_modes)
        return int(first + np.count_nonzero(self.modes[1:] != self.modes[:-1]))

    @property
    def time(self) -> FloatArray:
        """Time at each posture, starting from 0, shape (k + 1,) [s]."""
        return np.concatenate([[0.0], np.cumsum(self.duration)])

    @property
    def length(self) -> float:
        """Length of the polygon through the tip positions [m]."""
        return float(np.linalg.norm(np.diff(self.tip, axis=0), axis=1).sum())
