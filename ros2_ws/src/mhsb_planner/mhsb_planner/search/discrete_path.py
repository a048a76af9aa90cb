"""A discrete path: the result of the search over postures and modes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mhsb_model.types import FloatArray, ModeArray, frozen


@dataclass(frozen=True)
class SearchStatistics:
    """What a search took: states expanded, states generated (steps looked at), seconds.

    out_of_time: whether a deadline ended it, with the best path found until then
    """

    expanded: int
    generated: int
    seconds: float
    out_of_time: bool = False


@dataclass(frozen=True, eq=False)
class DiscretePath:
    """k steps of an arm with n joints, each at constant piston speeds and in one mode pattern.

    tip            float64[k + 1, 2], (x, z) m; float64[k + 1, 3], (x, y, z), where joint 1 slews
    posture        float64[k + 1, n], rad
    modes          uint8[k, n], mode of every actuator during each step
    duration       float64[k], s
    energy         float64[k], J, reading `paper`
    energy_series  float64[k], J, reading `series`
    cost           w₁ Σ E + w₂ Σ T + w₃ switches, the first step's switches included, and w₄ M
                   where the polytope's area has a weight (`area_shortfall`)
    start_modes    uint8[n], in force before the first step
    lower_bound    J, what any plan to one of the admissible goal postures must at least take
    statistics     of the search
    """

    tip: FloatArray
    posture: FloatArray
    modes: ModeArray
    duration: FloatArray
    energy: FloatArray
    energy_series: FloatArray
    cost: float
    start_modes: ModeArray
    lower_bound: float
    statistics: SearchStatistics

    def __post_init__(self) -> None:
        for name in ("tip", "posture", "duration", "energy", "energy_series"):
            object.__setattr__(self, name, frozen(np.asarray(getattr(self, name), dtype=float)))
        for name in ("modes", "start_modes"):
            object.__setattr__(self, name, frozen(np.asarray(getattr(self, name), dtype=np.uint8)))

    @classmethod
    def standing(
        cls, tip: FloatArray, posture: FloatArray, modes: ModeArray, seconds: float
    ) -> DiscretePath:
        """The path without steps of a start that is at its goal; `seconds` of search."""
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
            lower_bound=0.0,
            statistics=SearchStatistics(0, 0, seconds),
        )

    @property
    def steps(self) -> int:
        """Number of steps k."""
        return len(self.duration)

    @property
    def switches(self) -> int:
        """How often an actuator changes its mode, from the modes in force at the start on."""
        first = np.count_nonzero(self.modes[:1] != self.start_modes)
        return int(first + np.count_nonzero(self.modes[1:] != self.modes[:-1]))

    @property
    def time(self) -> FloatArray:
        """Time at each posture, from 0, float64[k + 1] s."""
        return np.concatenate([[0.0], np.cumsum(self.duration)])

    @property
    def length(self) -> float:
        """Length of the tip's path as a polygon [m]."""
        return float(np.linalg.norm(np.diff(self.tip, axis=0), axis=1).sum())
