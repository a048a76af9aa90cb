"""Commit horizon: the time from now until a new plan takes over from the old plan.

The commit horizon is the sum of two durations and the machine's dead time. The first duration is
the 0.95 quantile of the time from the request to the first feasible motion. The second is the 0.95
quantile of the time from the end of planning until the arm has confirmed the plan. No time is added
for improving a plan; a plan is improved in the time that is left of the horizon. Recent plans have
larger weights. So a horizon that has become long under load is short again after a few plans.
"""

from collections import deque
from typing import NamedTuple

import numpy as np

from mhsb_model.circuit.dead_time import compute_dead_time
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray

DURATION_QUANTILE = 0.95
"""Share of plans for which the commit horizon must be long enough [-]."""

SAMPLE_CAPACITY = 50
"""Number of last plans whose durations are kept."""

HALF_LIFE = 4.0
"""Number of newer plans after which the weight of a duration is halved.

So durations of 20 plans ago no longer affect the 0.95 quantile.
"""

LATE_PLAN_FACTOR = 1.5
"""Factor on the commit horizon of a plan that is made again because the first was late [-]."""

MIN_TRANSPORT_SHARE = 0.15
"""Least time for transport and confirmation, as a share of the time to the first motion.

If plans take long, their transport to the arm is delayed, too. A plan that comes too late costs its
whole commit horizon.
"""

OFFLINE_LEAD = 0.1
"""Commit horizon of plans in simulated time, which stands still during planning [s]."""

INITIAL_PLANNING_TIME, INITIAL_TRANSPORT_TIME = 0.02, 0.01
"""Durations that are assumed before anything has been measured [s].

They affect the first nine plans. A plan that needs more is made twice; its durations then count.
"""


def compute_offline_horizon(machine: Machine) -> float:
    """Compute the commit horizon of plans that are made in simulated time.

    The simulated time stands still while a plan is made, so planning takes no part of the horizon.

    Args:
        machine: Machine with its dead time.

    Returns:
        Commit horizon: `OFFLINE_LEAD` plus the machine's dead time [s].
    """
    return OFFLINE_LEAD + compute_dead_time(machine)


class CommitHorizon(NamedTuple):
    """Commit horizon of one plan.

    Attributes:
        total: Time from the plan's stamp until it deviates from the previous plan [s].
        transport_reserve: Part of this time that is reserved for encoding, transport and
            confirmation after planning [s].
        is_longest: True if a longer horizon is not allowed, because the horizon is fixed or at its
            upper bound.
    """

    total: float
    transport_reserve: float
    is_longest: bool


class CommitHorizonEstimator:
    """Estimator of the commit horizon from durations of earlier plans, by the steady clock."""

    def __init__(self) -> None:
        """Begin with INITIAL_PLANNING_TIME and INITIAL_TRANSPORT_TIME as the only samples."""
        self._first_motion: deque[float] = deque([INITIAL_PLANNING_TIME], maxlen=SAMPLE_CAPACITY)
        self._flight: deque[float] = deque([INITIAL_TRANSPORT_TIME], maxlen=SAMPLE_CAPACITY)

    def add_first_motion(self, seconds: float) -> None:
        """Add the time from the request for a plan to its first feasible motion [s]."""
        self._first_motion.append(seconds)

    def add_transport_time(self, seconds: float) -> None:
        """Add the time from the end of planning to the arm's confirmation [s].

        This time covers encoding, transport and the work of the receiver.
        """
        self._flight.append(seconds)

    @property
    def transport_time(self) -> float:
        """Estimated time from the end of planning to the arm's confirmation [s]."""
        return compute_recent_quantile(np.array(self._flight))

    @property
    def horizon(self) -> float:
        """Estimated commit horizon: time from a plan's stamp to its first new motion [s].

        This is the 0.95 quantile of the time to the first feasible motion, plus the time reserved
        for transport and confirmation.
        """
        return compute_recent_quantile(np.array(self._first_motion)) + self._transport_reserve

    @property
    def _transport_reserve(self) -> float:
        """Time to reserve for transport and confirmation [s].

        This is `transport_time`, but at least `MIN_TRANSPORT_SHARE` of the time to the first
        motion.
        """
        return max(
            self.transport_time,
            MIN_TRANSPORT_SHARE * compute_recent_quantile(np.array(self._first_motion)),
        )

    def choose_horizon(
        self, lower_bound: float, upper_bound: float, fixed_horizon: float, horizon_factor: float
    ) -> CommitHorizon:
        """Choose the commit horizon (time until a new plan takes over) and its part for transport.

        Without a fixed horizon, the commit horizon is the estimate times `horizon_factor`, limited
        to the bounds. The part for transport and confirmation is another estimate times
        `horizon_factor`, but at most half of the horizon. If the lower bound exceeds the estimate,
        the part grows by the difference, up to the longest transport of the last
        `SAMPLE_CAPACITY` plans: a late plan costs more than the time to improve it.

        Args:
            lower_bound: Lower bound [s].
            upper_bound: Upper bound [s].
            fixed_horizon: Horizon to use instead of the estimate, without regard to the bounds [s].
                0 means that the estimate is used.
            horizon_factor: Factor on both estimates [-]. It is above 1 if earlier plans for the
                goal came too late.

        Returns:
            Horizon [s], part for transport [s], and `is_longest`: the horizon is fixed or at its
            upper bound.
        """
        wanted = horizon_factor * self.horizon
        total = fixed_horizon or min(max(wanted, lower_bound), upper_bound)
        reserve = horizon_factor * self._transport_reserve
        longer_reserve = min(max(self._flight), reserve + total - wanted)
        return CommitHorizon(
            total,
            min(max(reserve, longer_reserve), 0.5 * total),
            is_longest=fixed_horizon > 0.0 or wanted >= upper_bound,
        )


def compute_recent_quantile(samples: FloatArray, quantile: float = DURATION_QUANTILE) -> float:
    """Compute a weighted quantile of samples, in which newer samples have larger weights.

    The weight of a sample is 0.5 ** (k / HALF_LIFE), with k the number of newer samples.

    Args:
        samples: Values in order of age, the newest last, shape (n,) with n at least 1.
        quantile: Share of the total weight, 0 to 1 [-].

    Returns:
        The smallest sample x such that all samples up to x together have at least this share.
    """
    weight = 0.5 ** (np.arange(len(samples))[::-1] / HALF_LIFE)
    order = np.argsort(samples)
    share = np.cumsum(weight[order]) / weight.sum()
    row = min(int(np.searchsorted(share, quantile - 1e-12)), len(samples) - 1)
    return float(samples[order][row])
